#!/bin/bash
# Which small faults in the C sources do the unit tests notice? tests/mutate/run.sh [ROOM...] [OPTIONS], by mutate.py, which lists
# rooms, options and exit codes with --help.
exec /usr/bin/python3 -B "$(dirname "$(readlink -f "$0")")/mutate.py" "$@"
