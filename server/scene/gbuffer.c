#include "gbuffer.h"
