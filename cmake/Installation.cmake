# `cmake --install build/release --prefix FOLDER`. The programs find each other in their own folder and
# what they read in ../share/b4mrl (proto/base/folders.h), so these two names are fixed and the whole
# may be moved.
install(TARGETS b4mrl b4mrl-serve b4mrl-render b4mrl-tools b4mrl-perf b4mrl-benchmark b4mrl-report
        RUNTIME DESTINATION bin)
install(DIRECTORY data/models data/agents DESTINATION share/b4mrl)
install(DIRECTORY data/replays DESTINATION share/b4mrl FILES_MATCHING PATTERN *.h5)
install(FILES data/datasets.toml benchmarks/budgets.toml benchmarks/claims.toml benchmarks/explanations.toml
        benchmarks/paper_parameters.csv
        DESTINATION share/b4mrl)
install(DIRECTORY benchmarks/suites DESTINATION share/b4mrl)
install(FILES benchmarks/performance/python_rates.py DESTINATION share/b4mrl/performance)
# The documents keep their places to each other, for they link to each other.
install(FILES LICENSE NOTICE CITATION.cff README.md ARCHITECTURE.md CHANGELOG.md CODE_OF_CONDUCT.md CONTRIBUTING.md
        REPRODUCIBILITY.md SECURITY.md TUTORIAL.md DESTINATION share/doc/b4mrl)
foreach(document proto/PROTOCOL.md data/README.md data/DATASHEET.md benchmarks/RESULTS.md benchmarks/RULES.md client/python/README.md)
  cmake_path(GET document PARENT_PATH folder)
  install(FILES ${document} DESTINATION share/doc/b4mrl/${folder})
endforeach()
install(DIRECTORY benchmarks/report DESTINATION share/doc/b4mrl/benchmarks)
install(DIRECTORY benchmarks/pictures DESTINATION share/doc/b4mrl/benchmarks FILES_MATCHING PATTERN *.png PATTERN *.svg)
