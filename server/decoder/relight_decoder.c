/* relight-decoder: started by relightd for pictures that came over the network; of no use by itself. */
#include "serve.h"

int main(int argc, char **argv)
{
    return decoder_serve(argc, argv, &(struct decoder_work){ decode_image });
}
