/* relight-video: the process that the programs start to decode video. */
#include "import/decoder/internal.h"

int main(int argc, char **argv)
{
    struct stream *stream = stream_create();

    return stream ? decoder_serve(
                        argc, argv,
                        &(struct decoder_work){ .decode = decode_image, .video = stream_work, .context = stream })
                  : 1;
}
