#!/bin/sh
# Generate and compile pianobot_msgs from msg_schemas/ into the virtual environment $1.
set -eu
venv=$(cd "$1" && pwd)
log=build/interfaces.log
mkdir -p build
AMENT_PREFIX_PATH=$venv
LD_LIBRARY_PATH=$venv/lib
PATH=$venv/bin:$PATH
export AMENT_PREFIX_PATH LD_LIBRARY_PATH PATH
echo "building pianobot_msgs (half a minute) …"
{
  cmake -S msg_schemas -B build/pianobot_msgs -DCMAKE_PREFIX_PATH="$venv" -DPython3_EXECUTABLE="$venv/bin/python" -DBUILD_TESTING=OFF -DONLY_PYTHON=ON &&
    cmake --build build/pianobot_msgs --parallel 2 &&
    cmake --install build/pianobot_msgs --prefix "$venv"
} >"$log" 2>&1 || {
  tail -n 20 "$log" >&2
  echo "pianobot: pianobot_msgs could not be built; the whole output is in $log" >&2
  exit 2
}
