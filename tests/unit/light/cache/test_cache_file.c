/* Files of tables: what was put comes back, and nothing else does. */
#include "light/cache/cache_file.h"
#include "scene/geometry/files.h"

#include <sys/stat.h>

static const struct digest one_key = { { 1, 2 } }, other_key = { { 1, 3 } };

/* Two sections: 200 bytes in three pieces, and seven. */
static void put_all(struct cache_writer *w)
{
    static uint8_t first[200];

    for (size_t i = 0; i < sizeof(first); i++)
        first[i] = (uint8_t)(i * 37 + i / 256);
    cache_writer_section(w, "first", &one_key);
    cache_writer_put(w, first, 1);
    cache_writer_put(w, first + 1, 0);
    cache_writer_put(w, first + 1, 100);
    cache_writer_put(w, first + 101, 99);
    cache_writer_section(w, "second", &other_key);
    cache_writer_put(w, "seven..", 7);
}

/* The file in a folder of its own; its bytes, to be freed with mem_free. */
static uint8_t *store_all(struct folder *f, char path[256], size_t *size)
{
    struct cache_writer *w = cache_writer_create();
    struct reason why = { "" };
    struct stat st;

    folder_make(f);
    snprintf(path, 256, "%s", folder_write(f, "tables", "", 0));
    assert_non_null(w);
    put_all(w);
    assert_int_equal(cache_writer_store(w, path, &why), ERR_OK);
    cache_writer_destroy(w);
    assert_int_equal(stat(path, &st), 0);
    *size = (size_t)st.st_size;
    uint8_t *bytes = mem_alloc(*size + 1, 1);
    FILE *in = fopen(path, "rb");
    assert_non_null(in);
    assert_int_equal(fread(bytes, 1, *size, in), *size);
    fclose(in);
    return bytes;
}

/* Reads both sections from their beginnings to their ends, the second first. */
static enum err read_all(const char *path, struct reason *why)
{
    struct cache_reader *r;
    uint8_t first[200], second[7];

    enum err e = cache_reader_open(path, &r, why);
    if (!e && !r)
        return ERR_END;
    if (!e)
        e = cache_reader_find(r, "second", &other_key, why);
    if (!e)
        e = cache_reader_get(r, second, 7, why);
    if (!e)
        e = cache_reader_end(r, why);
    if (!e)
        e = cache_reader_find(r, "first", &one_key, why);
    if (!e)
        e = cache_reader_get(r, first, 150, why);
    if (!e)
        e = cache_reader_get(r, first + 150, 50, why);
    if (!e)
        e = cache_reader_end(r, why);
    cache_reader_close(r);
    if (e)
        return e;
    assert_memory_equal(second, "seven..", 7);
    for (size_t i = 0; i < sizeof(first); i++)
        assert_int_equal(first[i], (uint8_t)(i * 37 + i / 256));
    return ERR_OK;
}

static void what_was_put_comes_back(void **state)
{
    struct folder f;
    char path[256];
    size_t size;
    struct reason why = { "" };
    (void)state;

    mem_free(store_all(&f, path, &size));
    assert_int_equal(read_all(path, &why), ERR_OK);
    folder_remove(&f);
    assert_int_equal(read_all(path, &why), ERR_END); /* there is none, which is no fault */
}

static void each_cut_and_each_flipped_bit_is_refused(void **state)
{
    struct folder f;
    char path[256];
    size_t size;
    struct reason why = { "" };
    (void)state;

    uint8_t *bytes = store_all(&f, path, &size);
    for (size_t cut = 0; cut < size; cut++) {
        folder_write(&f, "tables", bytes, cut);
        assert_int_equal(read_all(path, &why), ERR_FORMAT);
        assert_non_null(strstr(why.text, path));
    }
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        folder_write(&f, "tables", bytes, size);
        assert_int_equal(read_all(path, &why), ERR_FORMAT);
        assert_non_null(strstr(why.text, path));
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    folder_write(&f, "tables", bytes, size + 1);
    assert_int_equal(read_all(path, &why), ERR_FORMAT);
    folder_write(&f, "tables", bytes, size);
    assert_int_equal(read_all(path, &why), ERR_OK);
    mem_free(bytes);
    folder_remove(&f);
}

static void a_file_of_another_version_is_refused_as_one(void **state)
{
    struct folder f;
    char path[256];
    size_t size;
    struct reason why = { "" };
    (void)state;

    uint8_t *bytes = store_all(&f, path, &size);
    bytes[12]--; /* the version, of four bytes */
    folder_write(&f, "tables", bytes, size);
    assert_int_equal(read_all(path, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "another version"));
    mem_free(bytes);
    folder_remove(&f);
}

static void a_section_is_found_by_name_and_key_and_read_to_its_end(void **state)
{
    struct folder f;
    struct cache_reader *r;
    char path[256];
    uint8_t room[201];
    size_t size;
    struct reason why = { "" };
    (void)state;

    mem_free(store_all(&f, path, &size));
    assert_int_equal(cache_reader_open(path, &r, &why), ERR_OK);
    assert_int_equal(cache_reader_find(r, "third", &one_key, &why), ERR_END);
    assert_int_equal(cache_reader_find(r, "first", &other_key, &why), ERR_UNSUPPORTED);
    assert_int_equal(cache_reader_get(r, room, 1, &why), ERR_FORMAT); /* none was found */
    assert_int_equal(cache_reader_end(r, &why), ERR_FORMAT);
    assert_int_equal(cache_reader_find(r, "first", &one_key, &why), ERR_OK);
    assert_int_equal(cache_reader_get(r, room, 201, &why), ERR_FORMAT);
    assert_int_equal(cache_reader_get(r, room, 199, &why), ERR_OK);
    assert_int_equal(cache_reader_end(r, &why), ERR_FORMAT); /* a byte is left */
    assert_int_equal(cache_reader_get(r, room, 1, &why), ERR_OK);
    assert_int_equal(cache_reader_end(r, &why), ERR_OK);
    cache_reader_close(r);
    folder_remove(&f);
}

/* A pipe without a writer would hold up whoever opens it. */
static void what_is_no_plain_file_is_refused(void **state)
{
    struct folder f;
    char path[256];
    struct reason why = { "" };
    (void)state;

    folder_make(&f);
    assert_int_equal(read_all(f.path, &why), ERR_FORMAT);
    snprintf(path, sizeof(path), "%s", folder_write(&f, "pipe", "", 0));
    unlink(path);
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_int_equal(read_all(path, &why), ERR_FORMAT);
    folder_remove(&f);
}

static void a_folder_that_is_not_there_is_an_error_of_writing(void **state)
{
    struct cache_writer *w = cache_writer_create();
    struct reason why = { "" };
    (void)state;

    put_all(w);
    assert_int_equal(cache_writer_store(w, "/tmp/relight-no-such-folder/tables", &why), ERR_IO);
    assert_non_null(strstr(why.text, "relight-no-such-folder"));
    cache_writer_destroy(w);
}

/* More pieces than the system takes at a time, and a file that is replaced. */
static void thousands_of_pieces_are_one_section(void **state)
{
    enum { PIECES = 5000 };
    struct cache_writer *w = cache_writer_create();
    struct cache_reader *r;
    struct folder f;
    char path[256];
    uint32_t numbers[PIECES], back[PIECES];
    size_t size;
    struct reason why = { "" };
    (void)state;

    mem_free(store_all(&f, path, &size));
    cache_writer_section(w, "numbers", &one_key);
    for (uint32_t i = 0; i < PIECES; i++) {
        numbers[i] = i * i;
        cache_writer_put(w, &numbers[i], sizeof(numbers[i]));
    }
    assert_int_equal(cache_writer_store(w, path, &why), ERR_OK);
    cache_writer_destroy(w);
    assert_int_equal(cache_reader_open(path, &r, &why), ERR_OK);
    assert_int_equal(cache_reader_find(r, "first", &one_key, &why), ERR_END);
    assert_int_equal(cache_reader_find(r, "numbers", &one_key, &why), ERR_OK);
    assert_int_equal(cache_reader_get(r, back, sizeof(back), &why), ERR_OK);
    assert_int_equal(cache_reader_end(r, &why), ERR_OK);
    assert_memory_equal(numbers, back, sizeof(numbers));
    cache_reader_close(r);
    folder_remove(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_was_put_comes_back),
    cmocka_unit_test(each_cut_and_each_flipped_bit_is_refused),
    cmocka_unit_test(a_file_of_another_version_is_refused_as_one),
    cmocka_unit_test(a_section_is_found_by_name_and_key_and_read_to_its_end),
    cmocka_unit_test(what_is_no_plain_file_is_refused),
    cmocka_unit_test(a_folder_that_is_not_there_is_an_error_of_writing),
    cmocka_unit_test(thousands_of_pieces_are_one_section),
};
UNIT_MAIN(tests)
