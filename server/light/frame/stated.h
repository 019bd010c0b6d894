/* Audits the relighter's images and states their error (light/audit/audit.h): relighter_state_error of
 * relight_passes.h. Private to this room. Thread: the relighter's. */
#pragma once
struct stated;
void stated_destroy(struct stated *s); /* NULL is allowed */
