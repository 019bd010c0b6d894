"""test_mutants.py CLAIM: mutants.py on a few lines whose mutants are known, programs.py on a program of two files, and what
mutate.py remembers."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mutants
import mutate
from programs import Programs

SOURCE = """
#define SIZE (3 + 4)
static int table[9 + 1]; /* 1 + 2 */
static int rows[2][3 + 4] = { { 0 } };
enum { A = 2 };
static float scaled(const float *x, int n)
{
    float sum = 0.0f, side[5]; // 5 < 6
    const char *p = at(x), word[7];
    assert(n < 7);
    for (int i = 0; i < n; i++)
        sum += x[i] * 2e-3f;
    mem_free(x);
    report("1 + 1 < 3", n);
    take((const float(*)[3])x, n);
    return fminf(sum, 0x10);
}
"""


def lines_changed(source):
    return [(m.what, *mutants.line_of(source, m)) for m in mutants.mutants_of(source)]


def nothing_but_code_is_changed():
    found = lines_changed(SOURCE)
    assert {line for _, line, _, _ in found} == {4, 8, 11, 12, 14, 15, 16}, found
    assert not any('"1 - 1' in after or "5 <=" in after for _, _, _, after in found), found


def each_kind_is_found():
    found = [(what, after) for what, _, _, after in lines_changed(SOURCE)]
    for want in [("constant", "float sum = 1.0f, side[5]; // 5 < 6"), ("operator", "for (int i = 0; i <= n; i++)"),
                 ("operator", "sum -= x[i] * 2e-3f;"), ("constant", "sum += x[i] * (1.05f * 2e-3f);"), ("term dropped", "sum += x[i] ;"),
                 ("statement dropped", ";"), ("function", "return fmaxf(sum, 0x10);"), ("constant", "return fminf(sum, 17);"),
                 ("arguments swapped", 'report(n, "1 + 1 < 3");')]:
        assert want in found, (want, found)


def no_loop_is_made_endless():
    assert not any(what == "statement dropped" and after.startswith("for") for what, _, _, after in lines_changed(SOURCE))


def a_mutant_differs_from_its_source():
    for m in mutants.mutants_of(SOURCE):
        assert mutants.applied(SOURCE, m) != SOURCE, m


def code_for_other_processors_is_left_alone():
    source = "\n#if defined(__AVX512F__)\nint a(int x) { return x + 1; }\n#elif defined(__AVX2__)\nint b(int x) { return x - 2; }\n#endif\n" \
             "int c(int x) { return x * 3; }\n"
    every, here = ({line for _, line, _, _ in ((m.what, *mutants.line_of(source, m)) for m in mutants.mutants_of(source, lacks))}
                   for lacks in ((), ("__AVX512F__",)))
    assert every == {3, 5, 7} and here == {5, 7}, (every, here)


NINJA = """
rule cc
  command = cc -O2 -I{0}/server -o $out -MD -MF $out.d -c $in
  depfile = $out.d
  deps = gcc
rule ar
  command = ar qc $out $in
rule link
  command = : && cc $in -o $out libroom.a && :
build test.o: cc {0}/test.c
build room.o: cc ../server/room/room.c
build other.o: cc {0}/server/room/other.c
build libroom.a: ar room.o other.o
build bin/test: link test.o | libroom.a
"""
SOURCES = {"test.c": '#include "room/room.h"\nint main(void) { return twice(2) != FOUR || other(); }\n',
           "server/room/room.h": "#define FOUR 4\nint twice(int x);\nint other(void);\n",
           "server/room/room.c": '#include "room/room.h"\nint twice(int x) { return x + x; }\n',
           "server/room/other.c": "int other(void) { return 0; }\n"}


class Small:
    """A program of two rooms' files and a test, built."""

    def __init__(self, folder):
        self.tree, self.build = Path(folder), Path(folder) / "build"
        for name, text in {**SOURCES, "build/build.ninja": NINJA.format(folder)}.items():
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            (self.tree / name).write_text(text, encoding="utf-8")
        commands = [{"directory": str(self.build), "file": str(self.tree / source), "command": f"cc -O2 -I{folder}/server -o {o} -c {self.tree / source}"}
                    for o, source in (("test.o", "test.c"), ("room.o", "server/room/room.c"), ("other.o", "server/room/other.c"))]
        (self.build / "compile_commands.json").write_text(json.dumps(commands), encoding="utf-8")
        subprocess.run(["ninja", "-C", self.build, "-v"], check=True, stdout=subprocess.DEVNULL)
        self.programs = Programs(self.tree, self.build)
        self.programs.add("bin/test")

    def with_fault(self, name, before, after):
        """-> what it is made of, or None"""
        assert before in SOURCES[name]
        return self.programs.fault(Path(name), SOURCES[name].replace(before, after), self.tree / "worker", {"bin/test"})


def a_fault_is_in_a_program_of_its_own():
    with tempfile.TemporaryDirectory() as folder:
        small = Small(folder)
        for name, before, after, want in (("server/room/room.c", "x + x", "x - x", 1), ("server/room/room.c", "x + x", "2 * x", 0),
                                          ("server/room/room.h", "4", "5", 1), ("server/room/other.c", "return 0", "return 3", 1)):
            assert small.programs.holds("bin/test", Path(name))
            fault = small.with_fault(name, before, after)
            assert fault.link("bin/test") and subprocess.run([fault.folder / "bin/test"], check=False).returncode == want, (name, after)
            assert subprocess.run([small.build / "bin/test"], check=False).returncode == 0
            assert (fault.folder / "bin/../share").resolve() == small.build / "share"  # where programs look for it
        assert small.with_fault("server/room/room.c", "x + x", "x + y") is None


def code_that_stays_the_same_is_seen():
    with tempfile.TemporaryDirectory() as folder:
        small = Small(folder)
        codes = [small.with_fault("server/room/room.c", "x + x", now).code() for now in ("x + x", "x + x + 0", "x - x")]
        assert codes[0] == codes[1] != codes[2], codes


class Tests:
    """Stands in for a room's unit tests."""

    def __init__(self, name):
        self.room, self.claims = "room", [self]
        self.name, self.file, self.noticed = f"room.test_a.{name}", "test_a", {}


def what_was_found_holds_until_the_source_or_the_test_changes():
    with tempfile.TemporaryDirectory() as folder:
        mutate.TREE, mutate.RESULTS = Path(folder), Path(folder) / "results.txt"
        source, test = Path(folder) / "server/a.c", Path(folder) / "tests/unit/room/test_a.c"
        for path, text in ((source, "one"), (test, "static void fails(void **state)\n{\n}\n")):
            path.parent.mkdir(parents=True)
            path.write_text(text, encoding="utf-8")
        path = Path("server/a.c")
        m = mutate.Memory(Tests("fails"), False, "1234567", 20.0)
        for key, by in (("k", "room.test_a.fails"), ("s", "survived"), ("i", "invalid")):
            m.write(path, key, "", by)

        def known(seconds=20.0):
            return {key for _, key in mutate.Memory(Tests("fails"), True, "1234567", seconds).known}

        assert known() == {"k", "s", "i"} and not mutate.Memory(Tests("fails"), False, "1234567", 20.0).known
        assert known(30.0) == {"k", "i"}, "a test that takes longer may notice what survived"
        test.write_text(test.read_text(encoding="utf-8") + "static void more(void **state)\n{\n}\n", encoding="utf-8")
        assert known() == {"k", "i"}, "a new test may notice what survived"
        test.write_text("static void fails(void **state)\n{\n    return;\n}\n", encoding="utf-8")
        assert known() == {"i"}, "the test that noticed it is another"
        source.write_text("two", encoding="utf-8")
        assert not known()


if __name__ == "__main__":
    globals()[sys.argv[1]]()
