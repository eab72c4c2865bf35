#!/bin/sh
# Build ur-rtde into the virtual environment $1 for a Python that has no wheel of it (3.13).
#
# Its build wants to clone pybind11; the wheel of pybind11 serves as well, and needs no repository host. Link-time optimisation
# is switched off because it takes a quarter of an hour and gains nothing here.
set -eu
venv=$(cd "$1" && pwd)
"$venv/bin/python" -c 'import rtde_control' 2>/dev/null && exit 0
version=$(sed -n 's/^ur-rtde==\([0-9.]*\).*/\1/p' constraints.txt | head -n 1)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
echo "building ur-rtde $version from source (several minutes) …"
"$venv/bin/python" -m pip install --quiet pybind11==2.13.6
printf 'set(CMAKE_FIND_PACKAGE_TARGETS_GLOBAL TRUE)\nfind_package(pybind11 CONFIG REQUIRED)\n' >"$work/CMakeLists.txt"
cat >"$work/toolchain.cmake" <<END
set(FETCHCONTENT_SOURCE_DIR_PYBIND11-SRC $work)
set(pybind11_DIR $("$venv/bin/python" -m pybind11 --cmakedir))
set(CMAKE_INTERPROCEDURAL_OPTIMIZATION OFF)
END
CMAKE_TOOLCHAIN_FILE="$work/toolchain.cmake" MAKEFLAGS=-j2 CMAKE_BUILD_PARALLEL_LEVEL=2 \
  "$venv/bin/python" -m pip install --quiet "ur-rtde==$version"
