/* Writes the valid part of the corpus: make_corpus FOLDER. Inputs found by fuzzers are stored beside it under other
 * names. */
#include "image/codec/make_exr.h"
#include "image/codec/make_hdr.h"

#include <stdio.h>
#include <stdlib.h>

#define RGBE "FORMAT=32-bit_rle_rgbe"

static const struct made_channel rgb[] = {
    { "B", EXR_PIXEL_HALF }, { "G", EXR_PIXEL_HALF }, { "R", EXR_PIXEL_HALF }, { NULL, EXR_PIXEL_HALF }
};
static const struct made_channel mixed[] = {
    { "A", EXR_PIXEL_UINT },  { "B", EXR_PIXEL_HALF }, { "G", EXR_PIXEL_FLOAT },
    { "R", EXR_PIXEL_FLOAT }, { "Z", EXR_PIXEL_HALF }, { NULL, EXR_PIXEL_HALF }
};
static const struct made_channel layer[] = {
    { "sky.B", EXR_PIXEL_FLOAT }, { "sky.G", EXR_PIXEL_HALF }, { "sky.R", EXR_PIXEL_HALF }, { NULL, EXR_PIXEL_HALF }
};
static const struct made_channel grey[] = { { "Y", EXR_PIXEL_HALF }, { NULL, EXR_PIXEL_HALF } };
static const float aces[8] = { 0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f };

static const struct hdr_recipe hdrs[] = {
    { .scanlines = 3, .length = 5, .encoding = HDR_FLAT },
    { .scanlines = 3, .length = 12, .encoding = HDR_FLAT, .first = "+X", .second = "+Y" },
    { .scanlines = 3, .length = 20, .encoding = HDR_OLD_RLE, .header = RGBE "\nEXPOSURE=2\nCOLORCORR=1 2 3" },
    { .scanlines = 2, .length = 300, .encoding = HDR_OLD_RLE, .first = "-X", .second = "-Y" },
    { .scanlines = 3, .length = 20, .encoding = HDR_NEW_RLE, .header = "FORMAT=32-bit_rle_xyze" },
    { .scanlines = 2, .length = 140, .encoding = HDR_NEW_RLE, .header = "PRIMARIES=.7 .3 .2 .7 .1 .1 .33 .33" },
    { .scanlines = 2, .length = 9, .encoding = HDR_NEW_RLE, .first = "+Y", .second = "-X", .header = RGBE "\nGAMMA=1" },
};

static void save(const char *folder, const char *name, uint8_t *bytes, size_t size)
{
    char path[4096];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(bytes, 1, size, f) != size || fclose(f)) {
        perror(path);
        exit(1);
    }
    free(bytes);
}

static void save_exr(const char *folder, const char *name, const struct exr_recipe *recipes, int parts)
{
    size_t size;
    uint8_t *bytes = exr_make_parts(recipes, parts, &size);

    save(folder, name, bytes, size);
}

static void save_exrs(const char *folder)
{
    char name[64];

    for (int c = EXR_COMPRESSION_NONE; c <= EXR_COMPRESSION_B44A; c++) {
        const struct exr_recipe lines = {
            .channels = mixed, .compression = (exr_compression_t)c, .width = 9, .height = 10, .left = -2, .top = 3
        };
        const struct exr_recipe tiles = {
            .channels = rgb, .compression = (exr_compression_t)c, .width = 9, .height = 7, .tile_w = 8, .tile_h = 4
        };
        snprintf(name, sizeof(name), "exr/lines%d", c);
        save_exr(folder, name, &lines, 1);
        snprintf(name, sizeof(name), "exr/tiles%d", c);
        save_exr(folder, name, &tiles, 1);
    }
    const struct exr_recipe parts[] = {
        { .channels = grey, .width = 3, .height = 2, .deep = true },
        { .channels = layer, .width = 4, .height = 3, .compression = EXR_COMPRESSION_ZIPS },
    };
    save_exr(folder, "exr/parts", parts, 2);
    save_exr(folder, "exr/layer", &parts[1], 1);
    save_exr(folder, "exr/piz",
             &(struct exr_recipe){ .channels = rgb, .width = 24, .height = 33, .compression = EXR_COMPRESSION_PIZ }, 1);
    save_exr(
        folder, "exr/mip",
        &(struct exr_recipe){
            .channels = grey, .width = 8, .height = 4, .tile_w = 4, .tile_h = 4, .levels = EXR_TILE_MIPMAP_LEVELS },
        1);
    save_exr(folder, "exr/aces",
             &(struct exr_recipe){ .channels = rgb, .width = 4, .height = 2, .chromaticities = aces, .envmap = 1 }, 1);
}

int main(int argc, char **argv)
{
    char name[64];

    if (argc != 2) {
        fprintf(stderr, "usage: make_corpus FOLDER, which holds exr and hdr\n");
        return 2;
    }
    save_exrs(argv[1]);
    for (size_t i = 0; i < sizeof(hdrs) / sizeof(hdrs[0]); i++) {
        size_t size;
        uint8_t *bytes = hdr_make(&hdrs[i], &size);
        snprintf(name, sizeof(name), "hdr/made%zu", i);
        save(argv[1], name, bytes, size);
    }
    return 0;
}
