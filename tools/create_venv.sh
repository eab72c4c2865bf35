#!/bin/sh
# Create the virtual environment $1 with $PYTHON, or say in one line what is missing and how to get it.
set -eu
venv=$1
fail() { echo "pianobot: $1" >&2; exit 2; }

# Debian packages can be added where we are root; elsewhere the caller prints what to install.
add_packages() {
  [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1 || return 1
  echo "installing $* …"
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq -o DPkg::Lock::Timeout=600 "$@" >/dev/null
}

[ -x "$venv/bin/python" ] && exit 0
version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null; }

# ur-rtde and python-rtmidi come ready-made up to Python 3.12. With 3.13 an older Python on the machine is used instead,
# unless PYTHON was given a value of its own; otherwise they are built here.
case $(version "$PYTHON") in
3.10 | 3.11 | 3.12) ;;
3.13)
  if [ "$PYTHON" = python3 ]; then
    for other in python3.12 python3.11 python3.10; do
      [ -n "$(version $other)" ] && PYTHON=$other && echo "using $other, for which all packages come ready-made" && break
    done
  fi
  ;;
"") fail "'$PYTHON' does not run: install Python 3.10 to 3.13, or name one with make PYTHON=…" ;;
*) fail "$("$PYTHON" --version) is not supported: install Python 3.10 to 3.13 and name it, as in make PYTHON=python3.12" ;;
esac
if [ "$(version "$PYTHON")" = 3.13 ]; then
  needed="libboost-system-dev libboost-thread-dev libboost-program-options-dev libasound2-dev cmake"
  add_packages $needed || [ -d /usr/include/boost ] ||
    fail "Python 3.13 needs ur-rtde built from source: apt install $needed (as root), or use Python 3.10 to 3.12"
fi
for compiler in cc c++; do
  command -v $compiler >/dev/null 2>&1 || add_packages gcc g++ ||
    fail "no $compiler found, and the message types must be compiled: apt install gcc g++ (as root)"
done

"$PYTHON" -m venv "$venv" 2>/dev/null && exit 0
# Debian keeps ensurepip in a package of its own; a pip that is already there can stand in for it.
rm -rf "$venv"
"$PYTHON" -m venv --without-pip "$venv"
"$PYTHON" -m pip --python "$venv/bin/python" install --quiet pip 2>/dev/null && exit 0
rm -rf "$venv"
add_packages python3-venv && "$PYTHON" -m venv "$venv" ||
  fail "this Python cannot create virtual environments: apt install python3-venv (as root)"
