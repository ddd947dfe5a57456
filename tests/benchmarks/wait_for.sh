# For shell scripts of tests, which define `fail MESSAGE` for what has gone wrong.

# wait_for SECONDS WHAT COMMAND...: until the command succeeds; fails if it does not in time.
wait_for() {
  local end=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    [ $SECONDS -lt $end ] || fail "no sign in time that $what"
    sleep 0.2
  done
}

# say MESSAGE...: prints it behind the seconds since the script began.
say() { echo "$SECONDS s: $*"; }
