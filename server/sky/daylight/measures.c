#include "sky/daylight/measures.h"

#define LM83_HOURS 3650.0 /* from 8 to 18 on 365 days */

const struct measures_desc measures_lm83 = {
    .first_hour = 8.0,
    .last_hour = 18.0,
    .autonomy_lux = 300.0,
    .autonomy_share = 0.5,
    .sun_lux = 1000.0,
    .sun_hours = 250.0,
};

bool measures_occupied(const struct measures_desc *d, double clock)
{
    return clock >= d->first_hour && clock < d->last_hour;
}

static int udi_of(double lux)
{
    return lux < UDI_FELL_SHORT ? 0 : lux < UDI_SUPPLEMENTARY ? 1 : lux <= UDI_EXCEEDED ? 2 : 3;
}

void measures_add(const struct measures_desc *d, double clock, double span, const float *lux, const float *sun_lux,
                  size_t count, struct sensor_year *sensors)
{
    const bool occupied = measures_occupied(d, clock);

    for (size_t i = 0; i < count; i++) {
        struct sensor_year *s = &sensors[i];
        const double own = lux ? lux[i] : 0.0, sun = sun_lux ? sun_lux[i] : 0.0;
        s->lux_hours += span * own;
        s->lux_max = own > s->lux_max ? own : s->lux_max;
        if (!occupied)
            continue;
        s->autonomous += own >= d->autonomy_lux ? span : 0.0;
        s->udi[udi_of(own)] += span;
        s->sunlit += sun >= d->sun_lux ? span : 0.0;
    }
}

void measures_summarise(const struct measures_desc *d, const struct sensor_year *sensors, size_t count, double occupied,
                        struct measures_summary *out)
{
    const double sun_hours = d->sun_hours * occupied / LM83_HOURS;

    *out = (struct measures_summary){ .sda = 0.0 };
    for (size_t i = 0; i < count; i++) {
        const struct sensor_year *s = &sensors[i];
        out->sda += s->autonomous > 0.0 && s->autonomous >= d->autonomy_share * occupied - 1e-9 ? 1.0 : 0.0;
        out->ase += s->sunlit > sun_hours + 1e-9 ? 1.0 : 0.0;
        out->autonomy += s->autonomous / occupied;
        out->lux_hours += s->lux_hours;
        for (int k = 0; k < 4; k++)
            out->udi[k] += s->udi[k] / occupied;
    }
    if (count == 0)
        return;
    const double share = 1.0 / (double)count;
    out->sda *= share;
    out->ase *= share;
    out->autonomy *= share;
    out->lux_hours *= share;
    for (int k = 0; k < 4; k++)
        out->udi[k] *= share;
}
