#include "sky/between/between.h"
