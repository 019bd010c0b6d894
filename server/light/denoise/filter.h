/* Removes noise from the light at shade points, guided by the G-buffer: an edge-avoiding a-trous wavelet filter
 * [Dammertz et al. 2010], steered by variance as in SVGF [Schied et al. 2017].
 *
 * The light comes as two independent halves a and b of one image, each divided by the surface's reflectance. Every
 * level k replaces a point's light by the weighted mean over 5 x 5 pixels that are 2^k apart, with the weights
 *
 *     w = h(dx) h(dy) * max(0, n.n')^64 * (1 - (d / s)^2)+ * (1 - |y - y'|^2 / (9 (v + v')))+^2
 *
 * h is the B-spline (1, 4, 6, 4, 1) / 16, n the shading normal, d the distance from the point's tangent plane, s twice
 * the width of 2^k pixels there, y the light of the other half and v its variance. Points with other lobes, or seen in
 * a mirror, have weight 0. Where a pixel shows two unlike points (both sides of a leaf, a coat and the surface below,
 * a pane and what it reflects), the second ones are filtered as an image of their own.
 * Since a's weights come from b and b's from a, weights are not correlated with the noise that they average [Rousselle
 * et al. 2012]. The variance is (a - b)^2 / 2, averaged over 7 x 7 points with the first three factors, and then
 * propagated through the levels. Where both halves agree, nothing changes, so sharp sun shadows stay sharp.
 *
 * Finally, a point that is brighter than all 24 pixels around it is clamped to the brightest of them, unless its halves
 * agree within 3 %. A directly seen point in a shadow thinner than the filter, whose halves are both darker than the
 * filtered light y but not black, becomes m + w (y - m): m is the halves' mean, w = min(1, 4 (v / 2) / (m - y)^2) with
 * the averaged v.
 *
 * The filter is biased where light changes within the noise: docs/internals/where-methods-fail.md. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"

struct filter;

/* g and v, its camera's view, must outlive the filter. level: the CPU level (base/cpu.h); NULL: the best. Needs 96
 * bytes per pixel, twice that if a pixel shows two unlike points, and 96 for each further shade point.
 * NULL when out of memory. */
struct filter *filter_create(const struct gbuffer *g, const struct view *v, const char *level);
void filter_destroy(struct filter *f); /* NULL is allowed */

/* Writes the filtered mean of two independent estimates with the same expectation to `to`; all
 * float[packet_count][3][16], as direct_shade writes them, `to` none of the halves. Runs on all OpenMP threads; the
 * bits do not depend on their number. Thread: one at a time. */
void filter_run(struct filter *f, const float *const half[2], float *to);
