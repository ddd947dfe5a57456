#!/usr/bin/env bash
# Runs a command of this checkout on a bare Debian 12: a minimal chroot without sudo, compilers,
# locales or curl, in which the packages are installed as on a fresh machine.
#
#   tests/integration/bare_debian.sh [COMMAND [ARGUMENT...]]     default: ./quickstart
#
# Needs root, mmdebstrap and a Debian mirror. What is committed (HEAD) is what runs. The chroot is a
# new folder under $TMPDIR and is removed afterwards, unless B4MRL_KEEP_CHROOT is set;
# B4MRL_BASE_TARBALL names a tarball of an earlier `mmdebstrap --variant=minbase bookworm`.
# Ends with the command's exit code.
set -eu
checkout=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd)
[ "$(id -u)" -eq 0 ] || { echo "bare_debian.sh: a chroot needs root" >&2; exit 2; }
[ $# -gt 0 ] || set -- ./quickstart

root=$(mktemp -d "${TMPDIR:-/tmp}/b4mrl-bookworm.XXXXXX")
cleanup() { [ -n "${B4MRL_KEEP_CHROOT:-}" ] && echo "kept: $root" >&2 || rm -rf --one-file-system "$root"; }
trap cleanup EXIT

if [ -n "${B4MRL_BASE_TARBALL:-}" ]; then
  tar -C "$root" -xf "$B4MRL_BASE_TARBALL"
else
  mmdebstrap --quiet --variant=minbase bookworm "$root"
fi
cp /etc/resolv.conf "$root/etc/resolv.conf"
# As Debian's installer writes it.
printf '127.0.0.1\tlocalhost\n127.0.1.1\t%s\n' "$(hostname -s)" >"$root/etc/hosts"
git clone --quiet --no-hardlinks "file://$checkout" "$root/b4mrl"

# Mounts live in a namespace of their own and vanish with the command.
unshare --mount --pid --fork --kill-child bash -eu -c '
  root=$1
  shift
  mount -t proc proc "$root/proc"
  mkdir -p "$root/dev/shm" && mount -t tmpfs tmpfs "$root/dev/shm"
  mount --rbind /sys "$root/sys"
  mkdir -p "$root/dev/pts" && mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
  ln -sf pts/ptmx "$root/dev/ptmx"
  exec chroot "$root" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    sh -c "cd /b4mrl && exec \"\$@\"" sh "$@"
' bash "$root" "$@"
