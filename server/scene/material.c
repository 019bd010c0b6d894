#include "scene/material.h"

#include <assert.h>

const char *material_kind_name(enum material_kind kind)
{
    switch (kind) {
    case MATERIAL_LAMBERT: return "lambert";
    case MATERIAL_PHONG: return "phong";
    case MATERIAL_GGX: return "ggx";
    case MATERIAL_MIRROR: return "mirror";
    case MATERIAL_GLASS: return "glass";
    }
    assert(!"invalid material kind");
    return "";
}
