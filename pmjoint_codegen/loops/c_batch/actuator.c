#include "actuator.h"

#include <float.h>

/* Keep `value` in order; a second time it is not kept. */
static void insert(pmj_actuator *actuator, double value)
{
    int place = actuator->thresholds;
    for (int i = 0; i < actuator->thresholds; ++i) {
        if (actuator->at[i] == value) {
            return;
        }
    }
    while (place > 0 && actuator->at[place - 1] > value) {
        actuator->at[place] = actuator->at[place - 1];
        --place;
    }
    actuator->at[place] = value;
    actuator->thresholds += 1;
}

/* The limit of a channel for v in (low, high): -1, 0 or 1. */
static int side(const double *channel, double low, double high)
{
    const double offset = channel[0];
    const double slope = channel[1];
    if (slope == 0.0) {
        return (offset > channel[3]) - (offset < channel[2]);
    }
    const int rising = slope > 0.0 ? 1 : -1;
    const double first = (channel[2] - offset) / slope;
    const double second = (channel[3] - offset) / slope;
    if (high <= (rising > 0 ? first : second)) {
        return -rising;
    }
    return low >= (rising > 0 ? second : first) ? rising : 0;
}

void pmj_make_actuator(const double *limits, pmj_actuator *actuator)
{
    actuator->thresholds = 0;
    for (int j = 0; j < PMJ_NW; ++j) {
        const double *channel = limits + 4 * j;
        for (int end = 2; end < 4 && channel[1] != 0.0; ++end) {
            const double value = (channel[end] - channel[0]) / channel[1];
            if (fabs(value) <= DBL_MAX) {
                insert(actuator, value + 0.0); /* + 0.0 makes -0 and 0 one threshold */
            }
        }
    }
    for (int mode = 0; mode <= actuator->thresholds; ++mode) {
        const double low = mode > 0 ? actuator->at[mode - 1] : -HUGE_VAL;
        const double high = mode < actuator->thresholds ? actuator->at[mode] : HUGE_VAL;
        for (int j = 0; j < PMJ_NW; ++j) {
            const double *channel = limits + 4 * j;
            const int where = side(channel, low, high);
            actuator->modes[mode][2 * j] = where < 0 ? channel[2] : where > 0 ? channel[3] : channel[0];
            actuator->modes[mode][2 * j + 1] = where == 0 ? channel[1] : 0.0;
            actuator->labels[mode] = j == 0 ? where : actuator->labels[mode];
        }
    }
}

int pmj_mode_of(const pmj_actuator *actuator, double v)
{
    int mode = 0;
    while (mode < actuator->thresholds && v > actuator->at[mode]) {
        ++mode;
    }
    return mode;
}
