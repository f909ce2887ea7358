/* Feeds the exported code with broken measurements and clocks: whatever comes, commands
   stay finite and within the actuators' limits. Usage: fuzz [ticks] */
#include <stdio.h>
#include <stdlib.h>

#include "columns.h"

static uint64_t seed = 88172645463325252u;

/* A number in [0, 1), by xorshift. */
static double uniform(void)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (double)(seed >> 11) / 9007199254740992.0;
}

static glider_real wild(const double sound)
{
    switch ((int)(uniform() * 12.0)) {
    case 0: return (glider_real)NAN;
    case 1: return (glider_real)INFINITY;
    case 2: return (glider_real)-INFINITY;
    case 3: return (glider_real)1e30;
    case 4: return (glider_real)-1e30;
    case 5: return (glider_real)1e-40;
    case 6: return (glider_real)(1e6 * (uniform() - 0.5));
    case 7: return (glider_real)(40.0 * (uniform() - 0.5));
    case 8: return (glider_real)0.0;
    default: return (glider_real)sound;
    }
}

static glider_real clock_reading(const long n, const glider_real before)
{
    const double right = (double)n * GLIDER_DT;
    switch ((int)(uniform() * 10.0)) {
    case 0: return (glider_real)NAN;
    case 1: return (glider_real)INFINITY;
    case 2: return (glider_real)1e30;
    case 3: return before;
    case 4: return before - (glider_real)(10.0 * uniform());
    case 5: return (glider_real)(right + 100.0 * uniform());
    case 6: return (glider_real)-1.0;
    default: return (glider_real)right;
    }
}

int main(const int count, char **arguments)
{
    const long ticks = count > 1 ? strtol(arguments[1], NULL, 10) : 150000;
    double limits[COMMAND_COLUMNS], sound[MEASUREMENT_COLUMNS], given[MEASUREMENT_COLUMNS];
    long faulty = 0, said = 0;
    glider_real before = 0;
    glider_state state;
    glider_init(&state);
    write_limits(limits);
    for (int n = 0; n < MEASUREMENT_COLUMNS; n++) {
        sound[n] = 0.0;
    }
    for (long n = 0; n < ticks; n++) {
        /* Bursts of 1, 10 or 400 ticks, some longer than the autopilot's patience. */
        const long burst = n % 3000 < 1000 ? 1 : n % 3000 < 2000 ? 10 : 400;
        static int broken = 0;
        if (n % burst == 0) {
            broken = uniform() < 0.5;
        }
        glider_measurement measurement;
        glider_reference reference;
        glider_command command;
        for (int k = 1; k < MEASUREMENT_COLUMNS; k++) {
            sound[k] = 0.99 * sound[k] + 0.05 * (uniform() - 0.5);
            given[k] = broken ? (double)wild(sound[k]) : sound[k];
        }
        given[0] = broken ? (double)clock_reading(n, before) : (double)n * GLIDER_DT;
        if (!broken) {
            make_believable(given);
        }
        read_measurement(given, &measurement);
        before = measurement.time;
        glider_plan(&state, &measurement, &reference);
        if (broken && uniform() < 0.1) {
            spoil_reference(&reference, wild(0.0));
        }
        glider_step(&state, &measurement, &reference, &command);
        double is[COMMAND_COLUMNS];
        write_command(&command, is);
        faulty += broken;
        said += command.status != 0;
        for (int k = 0; k < COMMAND_COLUMNS - 1; k++) {
            if (!(fabs(is[k]) <= limits[k])) {
                printf("tick %ld: command %d is %g, its limit %g: FAIL\n", n, k, is[k],
                       limits[k]);
                return 1;
            }
        }
    }
    printf("fuzz: %ld ticks, %ld of them spoilt, %ld with a status, no command outside its "
           "limits: pass\n", ticks, faulty, said);
    return 0;
}
