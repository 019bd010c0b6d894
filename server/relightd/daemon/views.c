/* The cameras that settings may name: those of the scene, views that controllers have saved, and free views. */
#include "relightd/daemon/settings.h"

#include "relightd/daemon/config.h"
#include "scene/geometry/view.h"

#include <stdio.h>
#include <string.h>

/* {lock} */
static struct saved_view *find(struct settings_store *store, const char *name)
{
    for (unsigned i = 0; i < store->view_count; i++)
        if (strcmp(store->views[i].name, name) == 0)
            return &store->views[i];
    return NULL;
}

enum err settings_find_camera(struct settings_store *store, const char *name, struct camera *out, struct reason *why)
{
    const struct camera *camera = scene_camera(store->scene, name);
    char text[FREE_VIEW_TEXT] = "";

    if (camera) {
        const struct prepared_scene_desc *desc = &store->config->setup.set_desc;
        *out = *camera;
        return camera == scene_camera(store->scene, desc->camera)
                   ? view_change_apply(&desc->change, store->scene, out, why)
                   : ERR_OK;
    }
    pthread_mutex_lock(&store->lock);
    const struct saved_view *saved = find(store, name);
    snprintf(text, sizeof(text), "%s", saved ? saved->view : name);
    pthread_mutex_unlock(&store->lock);
    if (!free_view_is(text)) {
        char names[300];
        scene_camera_names(store->scene, names, sizeof(names));
        return err_say(why, ERR_USAGE, "there is no camera '%s'; expected %s", name, names);
    }
    return free_view_read(text, out, why);
}

enum err settings_save_view(struct settings_store *store, const char *name, const char *view, struct reason *why)
{
    struct camera c;
    enum err e = free_view_read(view, &c, why);

    if (!e && (free_view_is(name) || scene_camera(store->scene, name)))
        e = err_say(why, ERR_USAGE, "'%s' cannot be a view's name: it is a camera of the scene, or begins with @",
                    name);
    if (e)
        return e;
    pthread_mutex_lock(&store->lock);
    struct saved_view *v = find(store, name);
    if (!v && store->view_count < SAVED_VIEWS)
        v = &store->views[store->view_count++];
    if (v) {
        snprintf(v->name, sizeof(v->name), "%s", name);
        snprintf(v->view, sizeof(v->view), "%s", view);
    }
    pthread_mutex_unlock(&store->lock);
    atomic_store(&store->views_changed, true);
    return v ? ERR_OK : err_say(why, ERR_USAGE, "%d views are saved already: forget one first", SAVED_VIEWS);
}

enum err settings_forget_view(struct settings_store *store, const char *name, struct reason *why)
{
    pthread_mutex_lock(&store->lock);
    struct saved_view *v = find(store, name);
    if (v) {
        const size_t after = (size_t)(store->views + store->view_count - (v + 1));
        memmove(v, v + 1, after * sizeof(*v));
        store->view_count--;
    }
    pthread_mutex_unlock(&store->lock);
    atomic_store(&store->views_changed, true);
    return v ? ERR_OK : err_say(why, ERR_USAGE, "no view '%s' is saved", name);
}

unsigned settings_views(struct settings_store *store, struct saved_view *out)
{
    pthread_mutex_lock(&store->lock);
    const unsigned count = store->view_count;
    memcpy(out, store->views, sizeof(store->views));
    pthread_mutex_unlock(&store->lock);
    return count;
}
