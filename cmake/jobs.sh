# Sourced by quickstart and run_tests, in bash. Sets `cores`, the processors that this shell may use, and
# `jobs`: one compiler for each, as far as memory allows (the largest sources take about 1 GiB). Both
# heed the control groups of a container, as proto/base/cores.h does.

# group_files CONTROLLER FILE: the contents of FILE in this shell's group and in those around it, a line each.
group_files() {
  local number controllers path folder mount=/sys/fs/cgroup
  while IFS=: read -r number controllers path; do
    case ,$controllers, in
      ,,) folder=$mount$path ;;
      *,"$1",*) folder=$mount/$1$path ;;
      *) continue ;;
    esac
    while [[ $folder == $mount* ]]; do
      cat "$folder/$2" 2>/dev/null
      folder=${folder%/*}
    done
  done </proc/self/cgroup
}

cores=$(
  {
    nproc
    # A quota of processor time, rounded up: "150000 100000" are two processors.
    { group_files cpu cpu.max; paste -d ' ' <(group_files cpu cpu.cfs_quota_us) <(group_files cpu cpu.cfs_period_us); } |
      awk '$1 ~ /^[0-9]+$/ { print int(($1 + $2 - 1) / $2) }'
  } | sort -n | head -n 1
)
memory_gib=$(
  {
    awk '/^MemAvailable/ { print int($2 / 1048576) }' /proc/meminfo
    { group_files memory memory.max; group_files memory memory.limit_in_bytes; } |
      awk '$1 ~ /^[0-9]+$/ { printf "%.0f\n", $1 / 1073741824 - 0.5 }'
  } | sort -n | head -n 1
)
jobs=$((memory_gib < cores ? memory_gib : cores))
[ "$jobs" -ge 1 ] || jobs=1
