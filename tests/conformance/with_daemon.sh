#!/usr/bin/env bash
# Starts a daemon with a copy of the folder `data` on a free loopback port, runs a command with its
# endpoint, and stops it:
#   with_daemon.sh SERVE [FLAG ...] -- COMMAND [ARGUMENT ...]     ({} in an argument is the endpoint)
# Ends with the command's exit code; 70 if the daemon does not start, 77 (skipped) if the command
# does not exist.
set -u
serve=("$1")
shift
while [ "$1" != -- ]; do serve+=("$1"); shift; done
shift
if ! command -v "$1" >/dev/null; then
  echo "skipped: $1 is not installed"
  exit 77
fi
folder=$(mktemp -d) || exit 70
mkfifo "$folder/ready" && cp -r "$(dirname "$0")/data" "$folder" || exit 70
SPDLOG_LEVEL=warn XDG_CACHE_HOME=$folder/cache \
  "${serve[@]}" --bind tcp://127.0.0.1:0 --data "$folder/data" >"$folder/ready" &
daemon=$!
trap 'kill $daemon 2>/dev/null; wait $daemon 2>/dev/null; rm -rf "$folder"' EXIT
read -r -t 60 _ endpoint <"$folder/ready" || exit 70
"${@//\{\}/$endpoint}"
