#!/usr/bin/env bash
# An installation works, and still does when its folder has been moved: its programs read its own files,
# its documents link to nothing that is missing, and below ~/.local it leaves the user's data alone.
#
#   tests/integration/installation.sh CMAKE BUILD_FOLDER
set -eu
cmake=$1 build=$2
folder=$(mktemp -d "${TMPDIR:-/tmp}/b4mrl-installation.XXXXXX")
trap 'rm -rf "$folder"' EXIT
# Nothing but the installation and the home folder is to say where things are.
unset B4MRL_DATA B4MRL_ENDPOINT B4MRL_SERVER B4MRL_TOOLS B4MRL_PERF B4MRL_RUNNER B4MRL_REPORT XDG_DATA_HOME \
  XDG_CACHE_HOME
export HOME=$folder/home

fail() {
  echo "FAILED: $*" >&2
  exit 1
}

"$cmake" --install "$build" --prefix "$folder/first" >"$folder/log" || fail "$(cat "$folder/log")"
# Where the README installs to, and below which the user's datasets are, too.
prefix=$HOME/.local
mkdir "$HOME"
mv "$folder/first" "$prefix"
b4mrl=$prefix/bin/b4mrl
# By name, since a program of a checkout finds there what its installation lacks.
for file in bin/b4mrl-{serve,render,tools,perf,benchmark,report} \
  lib/b4mrl/{datasets,budgets,claims,explanations}.toml lib/b4mrl/paper_parameters.csv \
  lib/b4mrl/suites/{halfcheetah,highway,hopper,walker2d}.toml lib/b4mrl/suites/paper.csv lib/b4mrl/performance/python_rates.py \
  lib/b4mrl/models/{half_cheetah,hopper,walker2d,humanoid}.xml lib/b4mrl/agents/halfcheetah-medium.h5 \
  lib/b4mrl/replays/hopper-medium.h5 share/doc/b4mrl/{LICENSE,proto/PROTOCOL.md}; do
  [ -f "$prefix/$file" ] || fail "$file is missing"
done

# Every link of a document leads to something; [](const Type& name) of C++ has a space and is none.
links=0
while IFS= read -r -d '' document; do
  while read -r link; do
    case $link in http://* | https://* | '#'*) continue ;; esac
    links=$((links + 1))
    [ -e "$(dirname "$document")/${link%%#*}" ] || fail "$document links to $link, which is missing"
  done < <(grep -oE '\]\([^) ]+\)' "$document" | sed 's/^](//; s/)$//')
done < <(find "$prefix/share/doc/b4mrl" -name '*.md' -print0)
[ "$links" -ge 40 ] || fail "only $links links were found"

# Files that were installed are not the user's datasets: the list has those alone that are published and
# not made.
"$b4mrl" list datasets >"$folder/list" || fail "b4mrl list datasets"
others=$(grep -v -e ' not made; ' -e ' cannot be made: ' "$folder/list") && fail "datasets before any was made: $others"

# A private daemon steps HalfCheetah under the policy that was installed.
"$b4mrl" dataset make HalfCheetah/medium --rows 100 --quiet || fail "making a dataset"
[ -f "$prefix/share/b4mrl/HalfCheetah/medium-v0.h5" ] || fail "no dataset was written"
"$b4mrl" perf --help >/dev/null || fail "b4mrl perf"

# It plans the project's benchmarks, and makes the report of the results that it brought.
"$b4mrl" benchmark run 'HalfCheetah/confounding/hidden-high+medium' --budget smoke --out "$folder/suite" --dry-run \
  >"$folder/log" 2>&1 || fail "a plan of a benchmark: $(cat "$folder/log")"
"$b4mrl" report "$prefix/share/doc/b4mrl/benchmarks/results" --out "$folder/report" >"$folder/log" 2>&1 ||
  fail "a report: $(cat "$folder/log")"
[ -s "$folder/report/report.html" ] || fail "the report has no page"

# The tasks' models are parts of the program, whatever an upgrade does to the files of a running one.
echo "no model" >"$prefix/lib/b4mrl/models/half_cheetah.xml"
"$b4mrl" dataset make HalfCheetah/medium --rows 100 --replace --quiet >/dev/null || fail "a spoilt file of a model was read"
# Whose agents it reads shows when one is missing.
rm "$prefix/lib/b4mrl/agents/halfcheetah-medium.h5"
if "$b4mrl" dataset make HalfCheetah/medium --rows 100 --quiet 2>"$folder/log"; then
  fail "a missing agent was not missed"
fi
grep -q "$prefix/lib/b4mrl/agents" "$folder/log" || fail "$(cat "$folder/log")"
