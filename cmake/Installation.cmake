# `cmake --install build/release --prefix FOLDER`. The programs find each other in their own folder and
# what they read in ../lib/b4mrl (proto/base/folders.h), so these two names are fixed and the whole
# may be moved. share/b4mrl stays free: below ~/.local it is the folder of the user's own datasets.
install(TARGETS b4mrl b4mrl-serve b4mrl-render b4mrl-tools b4mrl-perf b4mrl-benchmark b4mrl-report
        RUNTIME DESTINATION bin)
install(DIRECTORY data/models data/agents DESTINATION lib/b4mrl)
install(DIRECTORY data/replays DESTINATION lib/b4mrl FILES_MATCHING PATTERN *.h5)
install(FILES data/datasets.toml benchmarks/budgets.toml benchmarks/claims.toml benchmarks/explanations.toml
        benchmarks/paper_parameters.csv
        DESTINATION lib/b4mrl)
install(DIRECTORY benchmarks/suites DESTINATION lib/b4mrl)
install(FILES benchmarks/performance/python_rates.py DESTINATION lib/b4mrl/performance)

# The documents, and what they link to, keep their places to each other.
foreach(document LICENSE NOTICE CITATION.cff README.md ARCHITECTURE.md CHANGELOG.md CODE_OF_CONDUCT.md
        CONTRIBUTING.md OPERATIONS.md REPRODUCIBILITY.md SECURITY.md TUTORIAL.md proto/PROTOCOL.md proto/b4mrl.proto
        proto/base/limits.h data/README.md data/DATASHEET.md data/datasets.toml benchmarks/CLUSTER.md
        benchmarks/FINDINGS.md benchmarks/RESULTS.md benchmarks/RULES.md benchmarks/budgets.toml
        benchmarks/leaderboard.csv client/remote_benchmark.h client/python/README.md)
  cmake_path(GET document PARENT_PATH folder)
  install(FILES ${document} DESTINATION share/doc/b4mrl/${folder})
endforeach()
install(DIRECTORY client/examples DESTINATION share/doc/b4mrl/client)
install(DIRECTORY benchmarks/report benchmarks/results DESTINATION share/doc/b4mrl/benchmarks)
install(DIRECTORY benchmarks/pictures DESTINATION share/doc/b4mrl/benchmarks FILES_MATCHING PATTERN *.png PATTERN *.svg)
