# Sourced, in bash, by the tests that install packages from PyPI, or from whichever index pip is configured
# for. They set `python`, the Python of their virtual environment, and define `skip REASON...`, which ends
# them with code 77.
#
#   make_environment FOLDER      makes the virtual environment anew; skips the test where python3-venv is
#                                missing or no package can be downloaded
#   install PIP-ARGUMENT...      ends the test with code 1 if that fails: where packages can be downloaded, a
#                                version or a package is wrong
export PYTHONDONTWRITEBYTECODE=1 PIP_DISABLE_PIP_VERSION_CHECK=1

make_environment() {
  python3 -m venv --clear "$1" || skip "python3-venv is not installed"
  local folder
  folder=$(mktemp -d) || exit 1
  # A small package that each of these tests needs. One attempt and short waits: without a network this is
  # to end soon.
  "$python" -m pip download --quiet --no-deps --no-cache-dir --timeout 10 --retries 1 --dest "$folder" packaging
  local status=$?
  rm -rf "$folder"
  [ $status -eq 0 ] || skip "packages of PyPI cannot be downloaded"
}

install() {
  "$python" -m pip install --quiet --timeout 30 --retries 3 "$@" && return
  echo "FAILED: packages can be downloaded, but not these installed: $*"
  exit 1
}
