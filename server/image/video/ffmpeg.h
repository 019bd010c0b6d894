/* FFmpeg's libavcodec, libavformat and libavutil, loaded with the first encoder or output instead of with the program.
 * They pull in 125 further libraries, which take four fifths of the time and a third of the memory of a program's
 * start, and few runs write video. The functions have their own names and types: ffmpeg()->av_frame_alloc(). */
#pragma once

#include <libavcodec/avcodec.h>
#ifdef RELIGHT_MOVIES /* a build with RELIGHT_VIDEO: movie.c, mux.c */
#include <libavformat/avformat.h>
#endif
#include <libavutil/mastering_display_metadata.h>
#include <libavutil/opt.h>

#define FFMPEG_UTIL(F)                                                                                                 \
    F(av_content_light_metadata_alloc)                                                                                 \
    F(av_d2q)                                                                                                          \
    F(av_dict_free)                                                                                                    \
    F(av_dict_parse_string)                                                                                            \
    F(av_frame_alloc)                                                                                                  \
    F(av_frame_free)                                                                                                   \
    F(av_frame_get_buffer)                                                                                             \
    F(av_frame_make_writable)                                                                                          \
    F(av_frame_unref)                                                                                                  \
    F(av_free)                                                                                                         \
    F(av_freep)                                                                                                        \
    F(av_log_set_level)                                                                                                \
    F(av_malloc)                                                                                                       \
    F(av_mallocz)                                                                                                      \
    F(av_mastering_display_metadata_alloc)                                                                             \
    F(av_opt_set)                                                                                                      \
    F(av_opt_set_double)                                                                                               \
    F(av_opt_set_int)                                                                                                  \
    F(av_strerror)

#define FFMPEG_CODEC(F)                                                                                                \
    F(av_new_packet)                                                                                                   \
    F(av_packet_alloc)                                                                                                 \
    F(av_packet_free)                                                                                                  \
    F(av_packet_rescale_ts)                                                                                            \
    F(av_packet_unref)                                                                                                 \
    F(avcodec_alloc_context3)                                                                                          \
    F(avcodec_find_encoder_by_name)                                                                                    \
    F(avcodec_free_context)                                                                                            \
    F(avcodec_open2)                                                                                                   \
    F(avcodec_receive_packet)                                                                                          \
    F(avcodec_send_frame)

#ifndef RELIGHT_MOVIES
#define FFMPEG_FORMAT(F)
#else
#define FFMPEG_FORMAT(F)                                                                                               \
    F(av_stream_add_side_data)                                                                                         \
    F(av_write_frame)                                                                                                  \
    F(av_write_trailer)                                                                                                \
    F(avformat_alloc_output_context2)                                                                                  \
    F(avformat_free_context)                                                                                           \
    F(avformat_new_stream)                                                                                             \
    F(avformat_write_header)                                                                                           \
    F(avio_alloc_context)                                                                                              \
    F(avio_closep)                                                                                                     \
    F(avio_context_free)                                                                                               \
    F(avio_flush)                                                                                                      \
    F(avio_open2)
#endif

struct ffmpeg {
#define FFMPEG_MEMBER(name) __typeof__(name) *name;
    FFMPEG_UTIL(FFMPEG_MEMBER)
    FFMPEG_CODEC(FFMPEG_MEMBER)
    FFMPEG_FORMAT(FFMPEG_MEMBER)
#undef FFMPEG_MEMBER
};

/* The functions; the first call loads the libraries. NULL, always then: one of them is missing or lacks a function.
 * What it returns stays valid. Thread: any. */
const struct ffmpeg *ffmpeg(void);
