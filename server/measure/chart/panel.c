#include "measure/chart/panel.h"

#include "base/mem.h"

#include <stdio.h>
#include <string.h>

static const char *const common_names[COMMON_PARTS] = { "decode", "rebuild", "tone", "encode" };

const char *common_name(enum common_part part)
{
    return common_names[part];
}

void panel_destroy(struct panel *p)
{
    if (!p)
        return;
    for (size_t c = 0; p->curves && c < p->curve_count; c++) {
        mem_free(p->curves[c].points);
        mem_free(p->curves[c].seconds);
        mem_free(p->curves[c].errors);
        mem_free(p->curves[c].images);
    }
    mem_free(p->curves);
    judge_finish(&p->judge);
    truth_finish(&p->truth);
    mem_free(p->mask);
    mem_free(p);
}

void panel_drop_images(struct panel *p)
{
    for (size_t c = 0; c < p->curve_count; c++) {
        mem_free(p->curves[c].images);
        p->curves[c].images = NULL;
    }
    for (int k = 0; k < 2; k++) {
        mem_free(p->truth.half[k]);
        p->truth.half[k] = NULL;
    }
    mem_free(p->judge.mean);
    mem_free(p->judge.weight);
    p->judge.mean = p->judge.weight = NULL;
    p->judge.a = p->judge.b = NULL;
}

/* Whether the name stands in the list, whole. */
static bool is_listed(const char *list, const char *name)
{
    const size_t n = strlen(name);

    for (const char *at = list; *at; at += strcspn(at, ","), at += *at == ',')
        if (strcspn(at, ",") == n && memcmp(at, name, n) == 0)
            return true;
    return false;
}

bool panel_takes(const char *techniques, const struct technique *t)
{
    return !techniques || is_listed(techniques, t->name);
}

enum err panel_check_techniques(const char *techniques, struct reason *why)
{
    size_t count;
    const struct technique *all = technique_all(&count);
    struct reason known = { "" };

    for (size_t t = 0; t < count; t++) {
        const size_t used = strlen(known.text);
        if (!is_listed(known.text, all[t].name))
            snprintf(known.text + used, sizeof(known.text) - used, "%s%s", used ? "," : "", all[t].name);
    }
    for (const char *at = techniques; at && *at; at += strcspn(at, ","), at += *at == ',') {
        char name[64];
        snprintf(name, sizeof(name), "%.*s", (int)strcspn(at, ","), at);
        if (!is_listed(known.text, name))
            return err_say(why, ERR_USAGE, "--techniques: '%s' is none; there are %s", name, known.text);
    }
    return ERR_OK;
}

struct curve panel_curve_of(const struct panel *p, size_t curve, enum error_kind kind)
{
    const struct panel_curve *c = &p->curves[curve];
    return (struct curve){
        .points = p->budget_count,
        .seeds = p->seeds,
        .seconds = c->seconds,
        .errors = c->errors + (size_t)kind * p->budget_count * p->seeds,
    };
}

void panel_title(const struct panel *p, char *title, size_t size)
{
    snprintf(title, size, "%s, %s: %s", p->scene, p->source, light_class_title(p->light_class));
}
