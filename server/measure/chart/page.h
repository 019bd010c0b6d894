/* The report for people: one self-contained HTML file. First it says which method to choose; then comes a panel for
 * each scene, sky and class of light, with charts, images at equal time and a table; last, how it was made. Main
 * thread. */
#pragma once

#include "base/text.h"
#include "measure/chart/machine.h"
#include "measure/chart/panel.h"
#include "measure/chart/winners.h"

struct page {
    const struct panel *const *panels;
    const struct winners *winners; /* [count], by ERROR_REL_MSE */
    const struct text *sections;   /* [count]: by page_add_panel */
    size_t count;
    struct machine machine;
    const char *command; /* the command line */
    double seconds;      /* that the run took */
};

/* The whole page. count >= 1. ERR_NOMEM. */
MUST_CHECK enum err page_write(const struct page *p, struct text *t, struct reason *why);

/* A panel's section, from the panel with its images and from the SVG files in the folder; number counts from 0.
 * ERR_NOMEM; ERR_IO or ERR_FORMAT: an SVG file cannot be included. */
MUST_CHECK enum err page_add_panel(struct text *t, const struct panel *p, const struct winners *w, size_t number,
                                   const char *folder, struct reason *why);

/* A panel's chart within the folder: "01-noon-direct.rel_mse.svg" and the like, into name[size]. */
void page_svg_name(const struct panel *p, size_t number, enum error_kind kind, char *name, size_t size);

/* The style sheet, and a technique's colour with its name. */
extern const char page_style[];
void page_add_swatch(struct text *t, const struct technique *q); /* its colour and name */
