#!/usr/bin/python3
"""Hosts on this machine, joined by links of a given rate and delay: network namespaces for MPI jobs. Needs root.

usage: links.py --hosts N --rate MBIT --delay MS -- PROGRAM ARGUMENT...

starts one rank of PROGRAM in each of N namespaces. Each has a TUN device, whose sending `tc tbf` limits to the rate; this process
carries the packets between them, holds each back for the delay (one way), and gives a receiver no more than the rate."""

import argparse
import collections
import fcntl
import os
import select
import struct
import subprocess
import sys
import tempfile
import threading
import time

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 1, 0x1000
NET = "10.77.31."


def run(*words):
    subprocess.run(words, check=True)


class Links:
    """A context; command() gives the words that start a job over the links."""

    def __init__(self, hosts, rate_mbit, delay_ms):
        self.hosts, self.rate, self.delay = hosts, rate_mbit * 1e6 / 8, delay_ms * 1e-3
        self.names = [f"relight-{os.getpid()}-{k}" for k in range(hosts)]
        self.fds, self.lost = [], 0
        self.carried = [0] * hosts  # bytes that each host has sent

    def __enter__(self):
        mtu = 9000 if self.rate < 50e6 else 32000  # so that this process can keep up
        try:
            for k, name in enumerate(self.names):
                run("ip", "netns", "add", name)
                fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
                self.fds.append(fd)
                device = f"rl{os.getpid() % 100000}.{k}"
                fcntl.ioctl(fd, TUNSETIFF, struct.pack("16sH", device.encode(), IFF_TUN | IFF_NO_PI))
                run("ip", "link", "set", device, "netns", name)
                inside = ("ip", "netns", "exec", name)
                run(*inside, "ip", "link", "set", "lo", "up")
                run(*inside, "ip", "addr", "add", f"{NET}{k + 1}/24", "dev", device)
                run(*inside, "ip", "link", "set", device, "mtu", str(mtu), "txqueuelen", "1000", "up")
                run(*inside, "tc", "qdisc", "add", "dev", device, "root", "tbf", "rate", f"{int(self.rate * 8)}bit", "burst",
                    str(max(2 * mtu, int(self.rate * 2e-3))), "limit", "4mb")
        except BaseException:
            self.__exit__()
            raise
        self.folder = tempfile.TemporaryDirectory()
        self.agent = os.path.join(self.folder.name, "agent")
        with open(self.agent, "w") as f:
            f.write(f'#!/bin/sh\nk=${{1##*.}}; shift\nexec ip netns exec relight-{os.getpid()}-$((k - 1)) unshare --uts sh -c '
                    '"hostname host$k; $*"\n')
        os.chmod(self.agent, 0o755)
        self.leaving = False
        self.thread = threading.Thread(target=self.carry)
        self.thread.start()
        return self

    def __exit__(self, *_):
        if hasattr(self, "thread"):
            self.leaving = True
            self.thread.join()
            self.folder.cleanup()
        for fd in self.fds:
            os.close(fd)
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], stderr=subprocess.DEVNULL)

    def carry(self):
        """Each receiver's packets leave in the order in which they came."""
        queues, free = [collections.deque() for _ in self.fds], [0.0] * self.hosts
        of = {fd: k for k, fd in enumerate(self.fds)}
        while not self.leaving:
            now = time.monotonic()
            due = min((q[0][0] for q in queues if q), default=now + 0.05)
            ready, _, _ = select.select(self.fds, [], [], max(0.0, due - now))
            now = time.monotonic()
            for fd in ready:
                for _ in range(8):
                    try:
                        packet = os.read(fd, 65536)
                    except BlockingIOError:
                        break
                    if packet[0] >> 4 != 4 or packet[16:19] != bytes(map(int, NET.split(".")[:3])):
                        continue
                    to = packet[19] - 1
                    self.carried[of[fd]] += len(packet)
                    if not 0 <= to < self.hosts:
                        continue
                    # A lone sender is held to the rate by tbf already; several are queued here.
                    free[to] = max(free[to], now - len(packet) / self.rate) + len(packet) / self.rate
                    queues[to].append((free[to] + self.delay, packet))
            now = time.monotonic()
            for k, q in enumerate(queues):
                while q and q[0][0] <= now:
                    try:
                        os.write(self.fds[k], q.popleft()[1])
                    except OSError:
                        self.lost += 1

    def command(self, program):
        hosts = ",".join(f"{NET}{k + 1}:1" for k in range(self.hosts))
        return ["ip", "netns", "exec", self.names[0], "unshare", "--uts", "sh", "-c", 'hostname host1; exec "$@"', "sh",
                "mpirun", "--host", hosts, "-n", str(self.hosts), "--bind-to", "none", "--mca", "plm", "rsh", "--mca", "plm_rsh_agent",
                self.agent, "--mca", "btl", "tcp,self", "--mca", "btl_tcp_if_include", f"{NET}0/24", "--mca", "oob_tcp_if_include",
                f"{NET}0/24", *program]


def environment():
    return dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hosts", type=int, default=2)
    parser.add_argument("--rate", type=float, default=1000.0, help="Mbit/s")
    parser.add_argument("--delay", type=float, default=0.1, help="ms, one way")
    parser.add_argument("program", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    program = options.program[1:] if options.program[:1] == ["--"] else options.program
    with Links(options.hosts, options.rate, options.delay) as links:
        status = subprocess.run(links.command(program), env=environment()).returncode
        print(f"links: {[round(b * 1e-6, 2) for b in links.carried]} MB sent by the hosts, {links.lost} packets lost", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
