#include "net/access/figures.h"

const char *server_publish_state_name(enum server_publish_state state)
{
    static const char *const names[] = { "waiting", "connecting", "live", "retrying" };

    return names[state];
}

/* clang-format off */
#define ROW(json, metric, help, type, field) { json, metric, help, type, offsetof(struct server_figures, field) }
#define U32(json, metric, help, field) ROW(json, metric, help, FIGURE_U32, field)
#define U64(json, metric, help, field) ROW(json, metric, help, FIGURE_U64, field)
#define BOOL(json, metric, help, field) ROW(json, metric, help, FIGURE_BOOL, field)
#define DOUBLE(json, metric, help, field) ROW(json, metric, help, FIGURE_DOUBLE, field)
#define KNOWN(json, metric, help, field) ROW(json, metric, help, FIGURE_KNOWN, field)
#define PLAIN(type, json, field) ROW(json, NULL, NULL, FIGURE_##type, field) /* in the status only */
#define TEXT(json, field) PLAIN(TEXT, json, field)
#define LIST(json, field) PLAIN(LIST, json, field)
#define FRAMES "relightd_frames_total"
#define RAYS "relightd_rays_total"
#define SAMPLES "relightd_light_samples_total"
#define FAILURES "relightd_decoder_failures_total"

const struct figure server_figure_table[] = {
    TEXT("scene", scene),
    TEXT("sky", sky),
    TEXT("method", method),
    PLAIN(U32, "samples", samples),
    PLAIN(U32, "width", width),
    PLAIN(U32, "height", height),
    TEXT("source.detail", detail),
    TEXT("source.kind", kind),
    PLAIN(U64, "source.position", position),
    PLAIN(U64, "source.length", length),
    TEXT("source.between", between),
    PLAIN(DOUBLE, "source.delay_s", between_delay_s),
    PLAIN(DOUBLE, "source.hour", hour),
    PLAIN(U32, "source.day", day),
    PLAIN(DOUBLE, "place.latitude", latitude),
    PLAIN(DOUBLE, "place.longitude", longitude),
    PLAIN(DOUBLE, "place.zone", zone),
    PLAIN(DOUBLE, "place.north", north),
    PLAIN(DOUBLE, "place.units", units),

    U64("frame", "relightd_frame_number", "Number of the environment frame that is shown.", frame),
    DOUBLE("fps", "relightd_pictures_per_second", "Images made per second, smoothed.", fps),
    PLAIN(DOUBLE, "stages_ms.queued", queued_ms),
    PLAIN(DOUBLE, "stages_ms.decoded", decoded_ms),
    PLAIN(DOUBLE, "stages_ms.shaded", shaded_ms),
    PLAIN(DOUBLE, "stages_ms.encoded", encoded_ms),
    U64("frames.received", "relightd_frames_received_total",
        "Environment frames received from any source.", received),
    U64("frames.used", FRAMES "{fate=\"shaded\",reason=\"\"}", "Environment frames by outcome.", used),
    U64("frames.dropped", FRAMES "{fate=\"dropped\",reason=\"superseded\"}", NULL, dropped),
    U64(NULL, FRAMES "{fate=\"refused\",reason=\"unreadable\"}", NULL, unreadable),
    U64(NULL, FRAMES "{fate=\"refused\",reason=\"unusable\"}", NULL, unusable),
    PLAIN(U64, "frames.refused", refused),
    TEXT("frames.last_refusal", last_refusal),
    U64("frames.repaired", "relightd_texels_repaired_total",
        "NaN, infinite and negative texels that were replaced.", repaired),

    U64("late.pictures", "relightd_late_pictures_total",
        "Images that took longer than --max-picture-seconds.", late),
    PLAIN(KNOWN, "late.seconds", late_s),

    PLAIN(DOUBLE, "light.sun.elevation", sun_elevation),
    PLAIN(DOUBLE, "light.sun.azimuth", sun_azimuth),
    TEXT("light.time", sky_time),
    TEXT("light.paths", paths),
    TEXT("light.left_out", left_out),
    KNOWN("light.error", "relightd_picture_error_ratio",
        "Estimated relMSE of the last image, without aliasing; absent when unknown.", error),
    KNOWN("light.error_at_most", "relightd_picture_error_at_most_ratio",
        "Upper bound of the last image's relMSE (two standard errors above the estimate); absent when none is known.",
        error_at_most),
    DOUBLE(NULL, "relightd_error_estimates_cpu_seconds_total",
        "Processor time spent on estimating images' errors, part of process_cpu_seconds_total.", audit_s),
    DOUBLE("light.computed", "relightd_cache_computed_ratio",
        "Share of the transport cache that is computed.", cache_share),
    PLAIN(U64, "light.passes", passes),
    PLAIN(BOOL, "light.converged", converged),
    U64(NULL, "relightd_finer_passes_total", "Refinement passes over still images.", all_passes),
    U64(NULL, "relightd_cache_bytes", "Size of the transport cache; 0 without one.", cache_bytes),
    U64(NULL, RAYS "{part=\"direct\"}", "Rays traced, by purpose.", direct_rays),
    U64(NULL, RAYS "{part=\"eye_paths\"}", NULL, eye_rays),
    U64(NULL, RAYS "{part=\"light_tracer\"}", NULL, light_rays),
    U64(NULL, RAYS "{part=\"cache\"}", NULL, cache_rays),
    U64(NULL, SAMPLES "{state=\"generated\"}", "Light samples: drawn, used, and used with light.", generated),
    U64(NULL, SAMPLES "{state=\"chosen\"}", NULL, chosen),
    U64(NULL, SAMPLES "{state=\"effective\"}", NULL, effective),

    BOOL(NULL, "relightd_decoder_separate",
        "1 if a separate process decodes producers' files.", decoder_separate),
    BOOL(NULL, "relightd_decoder_confined",
        "1 if the kernel limits that process to a few system calls.", decoder_confined),
    U64(NULL, "relightd_decoder_files_total",
        "Producers' files passed to the decoder process.", decoder_files),
    U64(NULL, "relightd_decoder_starts_total", "Decoder processes started.", decoder_starts),
    U64(NULL, FAILURES "{reason=\"died\"}",
        "Decoder crashes, and files that it failed on or refused to try.", decoder_died),
    U64(NULL, FAILURES "{reason=\"hung\"}", NULL, decoder_hung),
    U64(NULL, FAILURES "{reason=\"nonsense\"}", NULL, decoder_lied),
    U64(NULL, FAILURES "{reason=\"waiting\"}", NULL, decoder_waited),

    TEXT("camera", camera),
    TEXT("view", view),
    TEXT("preparing.camera", preparing),
    PLAIN(DOUBLE, "preparing.share", prepared),
    PLAIN(U32, "lamps.samples", lamp_samples),
    PLAIN(U32, "lamps.wanted", lamp_samples_wanted),
    LIST("offers.cameras", cameras),
    LIST("offers.views", views),
    { NULL, NULL, NULL, FIGURE_BOOL, 0 },
};
/* clang-format on */
