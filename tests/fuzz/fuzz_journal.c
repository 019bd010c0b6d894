/* The index of a recorder that was killed: complete lines stay, a partial line is removed, and another line can be
 * appended. */
#include "as_file.h"
#include "harness.h"

#include "clients/record/journal.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    static const char *const key[] = { "frame", NULL };
    struct journal j = { .fd = -1 };
    struct reason why = { "" };
    const char *path = as_file(".jsonl", bytes, size);

    for (int turn = 0; turn < 2; turn++) { /* the second finds the first one's result */
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
