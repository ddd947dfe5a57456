# Sourced by quickstart and run_tests. Sets `jobs`: one compiler a core, as far as memory allows
# (the largest sources take about 1 GiB).
available_gib=$(awk '/^MemAvailable/ {print int($2 / 1048576)}' /proc/meminfo)
jobs=$(nproc)
[ "${available_gib:-1}" -lt "$jobs" ] && jobs=${available_gib:-1}
[ "$jobs" -lt 1 ] && jobs=1
