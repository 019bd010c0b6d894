/* relight-decoder: the process that relightd starts to decode images from the network. */
#include "import/decoder/internal.h"

int main(int argc, char **argv)
{
    return decoder_serve(argc, argv, &(struct decoder_work){ .decode = decode_image });
}
