/* The list of what was recorded, as a recorder finds it that goes on where another was killed: whole lines stay, half a
 * line is cut off, and one more line can be added behind them. */
#include "as_file.h"
#include "harness.h"

#include "journal.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    static const char *const key[] = { "frame", NULL };
    struct journal j = { .fd = -1 };
    struct reason why = { "" };
    const char *path = as_file(".jsonl", bytes, size);

    for (int turn = 0; turn < 2; turn++) { /* the second finds what the first has left */
        if (journal_open(&j, path, &why)) {
            require(why.text[0] != 0, "a refusal has a reason");
            require(turn == 0, "what was written can be read");
            return 0;
        }
        require(!journal_add(&j, json_pack("{s:i,s:s}", "frame", 7, "file", "p.0007.exr"), key, &why),
                "a line is added");
        journal_close(&j);
    }
    return 0;
}
