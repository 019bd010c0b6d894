"""test_mutants.py CLAIM: mutants.py on a few lines whose mutants are known."""

import sys

import mutants

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


if __name__ == "__main__":
    globals()[sys.argv[1]]()
