#include "relightd/daemon/job.h"

#include "base/log.h"
#include "job/ranks/ranks.h"
#include "job/team/team.h"
#include "light/frame/part.h"
#include "relightd/daemon/shade.h"
#include "relightd/daemon/shared.h"

#include <omp.h>
#include <stdio.h>

#define CACHED_SAMPLES 64 /* N_s of the cache's images, as auto has them */

/* auto depends on the clock of one process. In a job it becomes the cache, whose images all ranks can light. */
static void choose_method(struct daemon_config *c)
{
    struct settings *now = &c->setup.initial;

    c->setup.light.cache_background = false; /* the ranks compute it before the first image */
    if (now->method != METHOD_AUTO || now->counted || now->error > 0.0)
        return;
    now->method = c->setup.light.direct.method = METHOD_CACHED;
    now->samples = c->setup.light.direct.samples = CACHED_SAMPLES;
}

static struct team_desc describe(const struct shared *s, struct relighter *r)
{
    const struct setup *setup = &s->config.setup;

    return (struct team_desc){ .ranks = s->ranks,
                               .relighter = r,
                               .environment = &setup->environment,
                               .cache_file = setup->light.cache_file,
                               .cache_dir = setup->light.cache_dir,
                               .cancel = s->stop,
                               .whole = true,
                               .half = s->config.part_floats != PART_FLOAT };
}

enum err job_join(struct job *j, struct shared *s, int argc, char **argv, struct reason *why)
{
    const struct ranks_desc desc = { "relightd", s->config.setup.kernels->level, argc, argv };
    const enum err e = ranks_create(&desc, &s->ranks, why);

    j->joined = s->ranks || (e && !why->text[0]);
    if (e || !s->ranks)
        return e;
    snprintf(j->name, sizeof(j->name), "relightd, %s", ranks_name(s->ranks));
    log_init(j->name, s->config.log.level);
    log_configure(&s->config.log);
    if (!s->config.setup.threads)
        omp_set_num_threads((int)ranks_threads(s->ranks));
    ranks_set_stop(s->ranks, s->stop);
    choose_method(&s->config);
    return ERR_OK;
}

enum err job_lead(struct job *j, struct shared *s, struct shade_thread *shade, struct reason *why)
{
    struct relighter *r = shade->first_relighter;
    const struct team_desc desc = describe(s, r);

    if (!s->ranks) {
        relighter_round(r, s->config.part_floats == PART_HALF);
        return ERR_OK;
    }
    const enum err e = team_create(&desc, &j->team, why);
    if (!e)
        team_look_ahead(j->team, shade_thread_next, shade);
    if (!e)
        log_info(
            "%u ranks light images of the first camera; rank 0 alone lights other cameras and refines still images",
            ranks_count(s->ranks));
    return e;
}

static enum err make(const struct shared *s, struct prepared_scene **set, struct relighter **r, struct reason *why)
{
    enum err e = set_create(&s->config.setup.set_desc, set, why);

    if (e)
        return e;
    *r = relighter_create(*set, s->config.setup.kernels);
    return *r ? ERR_OK : err_say(why, ERR_NOMEM, "no memory for this rank's part of the images");
}

enum err job_serve(struct job *j, struct shared *s, struct reason *why)
{
    struct prepared_scene *set = NULL;
    struct relighter *r = NULL;

    s->config.setup.set_desc.progress = false;
    enum err e = ranks_agree(s->ranks, make(s, &set, &r, why), why);
    const struct team_desc desc = describe(s, r);
    if (!e)
        e = team_create(&desc, &j->team, why);
    if (!e)
        e = team_serve(j->team, why);
    team_destroy(j->team);
    relighter_destroy(r);
    set_destroy(set);
    return e;
}

void job_leave(struct job *j)
{
    team_destroy(j->team);
    j->team = NULL;
}
