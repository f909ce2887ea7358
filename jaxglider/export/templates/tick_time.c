/* How long a tick takes on this machine, over the recorded measurements. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "columns.h"

#define TICKS 200000
#define MAX_ROWS 1000

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

int main(void)
{
    static glider_measurement rows[MAX_ROWS];
    static double taken[TICKS];
    char line[8192];
    int count = 0;
    FILE *file = fopen("test/vectors.csv", "r");
    if (file == NULL || fgets(line, sizeof line, file) == NULL) {
        fprintf(stderr, "tick_time: test/vectors.csv cannot be read.\n");
        return 2;
    }
    while (count < MAX_ROWS && fgets(line, sizeof line, file) != NULL) {
        double row[MEASUREMENT_COLUMNS];
        char *at = line;
        for (int n = 0; n < MEASUREMENT_COLUMNS; n++) {
            row[n] = strtod(at, &at);
            at += *at == ',';
        }
        read_measurement(row, &rows[count++]);
    }
    fclose(file);
    glider_state state;
    glider_init(&state);
    double sum = 0.0;
    for (int n = 0; n < TICKS; n++) {
        glider_measurement measurement = rows[n % count];
        glider_reference reference;
        glider_command command;
        measurement.time = (glider_real)(n * GLIDER_DT);
        const double begin = seconds();
        glider_plan(&state, &measurement, &reference);
        glider_step(&state, &measurement, &reference, &command);
        taken[n] = seconds() - begin;
        sum += (double)command.mass_angle;
    }
    qsort(taken, TICKS, sizeof taken[0], ascending);
    printf("%s: median %.2f us, 99.9 %% below %.2f us, worst %.1f us of %d ticks; "
           "state %u bytes (%.3g)\n",
           sizeof(glider_real) == sizeof(float) ? "float" : "double", 1e6 * taken[TICKS / 2],
           1e6 * taken[TICKS - TICKS / 1000], 1e6 * taken[TICKS - 1], TICKS,
           (unsigned)sizeof state, sum);
    return 0;
}
