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

/* The values of v at which the valve's output bends or jumps, ascending; their number. */
static int valve_points(const pmj_chain *valve, double *points)
{
    const double more = valve->own - valve->zone; /* of v that is lost beyond what the controller adds */
    const double right = valve->upper - valve->zone;
    const double left = valve->lower + valve->zone;
    const double lost = more > 0.0 ? more : 0.0;
    const double most = right > 0.0 ? right : 0.0;
    const double least = left < 0.0 ? left : 0.0;
    points[0] = least < -lost ? least : -lost;
    points[1] = least < -lost ? -lost : least;
    points[2] = 0.0;
    points[3] = most < lost ? most : lost;
    points[4] = most < lost ? lost : most;
    return 5;
}

/* A channel behind the valve as a function of v in (low, high), in which the valve is affine. */
static void behind(const double *channel, const pmj_chain *valve, double low, double high, double *found)
{
    double before = 0.0;
    double gain = 1.0;
    if (valve) {
        const double more = valve->own - valve->zone;
        gain = 0.0;
        if (low >= 0.0 && low >= valve->upper - valve->zone) { /* the command is at its limit */
            before = valve->upper - valve->own > 0.0 ? valve->upper - valve->own : 0.0;
        } else if (low >= 0.0) {
            gain = low >= more ? 1.0 : 0.0;
            before = low >= more ? -more : 0.0;
        } else if (high <= valve->lower + valve->zone) {
            before = valve->lower + valve->own < 0.0 ? valve->lower + valve->own : 0.0;
        } else {
            gain = high <= -more ? 1.0 : 0.0;
            before = high <= -more ? more : 0.0;
        }
    }
    found[0] = valve ? channel[0] + channel[1] * before : channel[0];
    found[1] = valve ? channel[1] * gain : channel[1];
    found[2] = channel[2];
    found[3] = channel[3];
}

/* Keep the thresholds of a channel that lie in (low, high). */
static void insert_of(pmj_actuator *actuator, const double *channel, double low, double high)
{
    for (int end = 2; end < 4 && channel[1] != 0.0; ++end) {
        const double value = (channel[end] - channel[0]) / channel[1];
        if (fabs(value) <= DBL_MAX && value > low && value < high) {
            insert(actuator, value + 0.0); /* + 0.0 makes -0 and 0 one threshold */
        }
    }
}

void pmj_make_actuator(const double *limits, const pmj_chain *valve, pmj_actuator *actuator)
{
    double points[5];
    const int count = valve ? valve_points(valve, points) : 0;
    double found[4];
    actuator->thresholds = 0;
    for (int i = 0; i < count; ++i) {
        insert(actuator, points[i] + 0.0);
    }
    insert_of(actuator, limits, -HUGE_VAL, HUGE_VAL);
    for (int i = 0; i <= count; ++i) {
        const double low = i > 0 ? points[i - 1] : -HUGE_VAL;
        const double high = i < count ? points[i] : HUGE_VAL;
        for (int j = 1; j < PMJ_NW && low < high; ++j) {
            behind(limits + 4 * j, valve, low, high, found);
            insert_of(actuator, found, low, high);
        }
    }
    for (int mode = 0; mode <= actuator->thresholds; ++mode) {
        const double low = mode > 0 ? actuator->at[mode - 1] : -HUGE_VAL;
        const double high = mode < actuator->thresholds ? actuator->at[mode] : HUGE_VAL;
        for (int j = 0; j < PMJ_NW; ++j) {
            behind(limits + 4 * j, j == 0 ? 0 : valve, low, high, found);
            const int where = side(found, low, high);
            actuator->modes[mode][2 * j] = where < 0 ? found[2] : where > 0 ? found[3] : found[0];
            actuator->modes[mode][2 * j + 1] = where == 0 ? found[1] : 0.0;
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
