/* Audits the relighter's pictures and states their error (light/audit/audit.h): relighter_state_error of
 * relight_passes.h. Private to this room. Thread: the relighter's. */
#pragma once
struct stated;
void stated_destroy(struct stated *s); /* NULL is allowed */
