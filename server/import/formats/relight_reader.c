/* relight-reader: the process that reads scene files for the programs that show them. */
#include "import/formats/import.h"
#include "import/reader/host.h"

#include <jansson.h>

int main(int argc, char **argv)
{
    json_object_seed(0); /* reads /dev/urandom, which it cannot later */
    return reader_serve(argc, argv, import_scene);
}
