"""What the scripts share that a program starts to show what it measures (server/measure/chart/script.h)."""

import json
import os
import re
import signal
import sys
import time


def serve(take):
    """Takes each line of JSON from standard input, a socket, and answers it when that work is done: with what went wrong."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the program ends, and with it the input
    for line in sys.stdin.buffer:
        fault = ""
        try:
            take(json.loads(line))
        except OSError as error:
            fault = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        os.write(0, fault.encode(errors="replace")[:300] + b"\n")


def processor():
    with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        model = re.search(r"^model name\s*:\s*(.*)$", file.read(), re.M)
    return model[1] if model else "unknown"


def date():
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())
