#!/usr/bin/env bash
# An installation works, and still does when its folder has been moved: its programs read its own files.
#
#   tests/integration/installation.sh CMAKE BUILD_FOLDER
set -eu
cmake=$1 build=$2
folder=$(mktemp -d "${TMPDIR:-/tmp}/b4mrl-installation.XXXXXX")
trap 'rm -rf "$folder"' EXIT
# Nothing but the installation is to say where things are.
unset B4MRL_AGENTS B4MRL_ENDPOINT B4MRL_SERVER B4MRL_TOOLS B4MRL_PERF
export XDG_DATA_HOME=$folder/data XDG_CACHE_HOME=$folder/cache

fail() {
  echo "FAILED: $*" >&2
  exit 1
}

"$cmake" --install "$build" --prefix "$folder/first" >"$folder/log" || fail "$(cat "$folder/log")"
mv "$folder/first" "$folder/moved"
b4mrl=$folder/moved/bin/b4mrl
for file in share/b4mrl/datasets.toml share/b4mrl/replays/hopper-medium.h5 share/doc/b4mrl/LICENSE share/doc/b4mrl/proto/PROTOCOL.md bin/b4mrl-render; do
  [ -f "$folder/moved/$file" ] || fail "$file is missing"
done

# A private daemon steps HalfCheetah under the policy that was installed.
"$b4mrl" dataset make HalfCheetah/medium --rows 100 --quiet || fail "making a dataset"
[ -f "$folder/data/b4mrl/HalfCheetah/medium-v0.h5" ] || fail "no dataset was written"
"$b4mrl" perf --help >/dev/null || fail "b4mrl perf"

# Whose models and agents it reads shows when they are spoilt.
echo "no model" >"$folder/moved/share/b4mrl/models/hopper.xml"
if "$b4mrl" train --algorithm sac --environment Hopper --updates 1 --out "$folder/run" \
  >"$folder/log" 2>&1; then
  fail "a spoilt model was not read"
fi
grep -q "$folder/moved/share/b4mrl/models/hopper.xml" "$folder/log" || fail "$(cat "$folder/log")"
rm "$folder/moved/share/b4mrl/agents/halfcheetah-medium.h5"
if "$b4mrl" dataset make HalfCheetah/medium --rows 100 --quiet 2>"$folder/log"; then
  fail "a missing agent was not missed"
fi
grep -q "$folder/moved/share/b4mrl/agents" "$folder/log" || fail "$(cat "$folder/log")"
