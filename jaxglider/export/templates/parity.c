/* Checks that the exported code does what was tuned: tick by tick on recorded
   measurements, sound and spoilt, and in closed loop with the simulated glider. */
#include <stdio.h>
#include <stdlib.h>

#include "plant.h"

#include "columns.h"

#define MAX_LINE 8192
#define MAX_COLUMNS 64
#define HOLD 20 /* ticks from one row of closed_loop.csv to the next */

/* Largest allowed difference: of a command from what JAX computed, over the larger of
   its size and a tenth of the actuator's limit; and of a state of the glider in closed
   loop, over the larger of its size and 1. Rows are compared as far as rounding alone
   does not make a difference in JAX itself: some loops are chaotic. */
#ifdef GLIDER_FLOAT
#define PRECISION "float"
#define ROWS(file) file##_FLOAT_ROWS
static const double command_allowed = COMMAND_FLOAT, state_allowed = STATE_FLOAT;
#else
#define PRECISION "double"
#define ROWS(file) file##_DOUBLE_ROWS
static const double command_allowed = 1e-10, state_allowed = 1e-10;
#endif

static double distance(const double is, const double wanted, const double least)
{
    const double size = fabs(wanted) > least ? fabs(wanted) : least;
    const double off = fabs(is - wanted) / size;
    return off >= 0.0 ? off : HUGE_VAL; /* NaN is as far as can be */
}

static int read_line(FILE *file, double *row, const int columns)
{
    char line[MAX_LINE];
    if (fgets(line, sizeof line, file) == NULL) {
        return 0;
    }
    char *at = line;
    for (int n = 0; n < columns; n++) {
        char *end = at;
        row[n] = strtod(at, &end);
        if (end == at) {
            fprintf(stderr, "parity: column %d of a line is no number: %s\n", n + 1, line);
            exit(2);
        }
        at = *end == ',' ? end + 1 : end;
    }
    return 1;
}

static FILE *opened(const char *name)
{
    char header[MAX_LINE];
    FILE *file = fopen(name, "r");
    if (file == NULL || fgets(header, sizeof header, file) == NULL) {
        fprintf(stderr, "parity: %s cannot be read; run make in its folder.\n", name);
        exit(2);
    }
    return file;
}

/* Number of lines that are left. */
static long lines_left(FILE *file)
{
    char line[MAX_LINE];
    long count = 0;
    while (fgets(line, sizeof line, file) != NULL) {
        count++;
    }
    return count;
}

/* Ticks before the mission's end, and those of them whose command is the law's own
   answer to a measurement that was believed. */
static long under_way, steered;

static void count_steered(const glider_command *command)
{
    const long idle = GLIDER_MEASUREMENT_HELD | GLIDER_MEASUREMENT_LOST
                      | GLIDER_REFERENCE_HELD | GLIDER_COMMAND_HELD;
    if (!(command->status & GLIDER_FINISHED)) {
        under_way++;
        steered += !(command->status & idle);
    }
}

static int verdict(const char *name, const long ticks, const long left_out,
                   const double worst, const double allowed)
{
    const int idle = 100 * steered <= under_way;
    const int fine = worst <= allowed && !idle;
    printf("%-6s  %-21s %6ld ticks, worst difference %.2e, allowed %.0e: %s\n", PRECISION,
           name, ticks, worst, allowed, fine ? "pass" : "FAIL");
    if (left_out) {
        printf("%s: %ld more ticks are left out: rounding alone makes a difference there\n",
               name, left_out);
    }
    if (idle) {
        printf("%s: the controller steers on %ld ticks; see their status\n", name, steered);
    }
    under_way = steered = 0;
    return fine ? 0 : 1;
}

/* Tick by tick: measurement, reference, command and status stand in each line. */
static int ticks(const char *name, const int rows, const int strict_status)
{
    FILE *file = opened(name);
    double row[MAX_COLUMNS], worst = 0.0;
    long count = 0, words = 0;
    glider_state state;
    glider_init(&state);
    while (count < rows && read_line(file, row, ROW_COLUMNS)) {
        glider_measurement measurement;
        glider_reference reference;
        glider_command command;
        read_measurement(row, &measurement);
        glider_plan(&state, &measurement, &reference);
        glider_step(&state, &measurement, &reference, &command);
        double planned[REFERENCE_COLUMNS + 1], is[COMMAND_COLUMNS], limits[COMMAND_COLUMNS];
        write_reference(&reference, planned);
        write_command(&command, is);
        write_limits(limits);
        for (int n = 0; n < REFERENCE_COLUMNS; n++) {
            const double off = distance(planned[n], row[MEASUREMENT_COLUMNS + n], 1.0);
            worst = off > worst ? off : worst;
        }
        const double *wanted = row + MEASUREMENT_COLUMNS + REFERENCE_COLUMNS;
        for (int n = 0; n < COMMAND_COLUMNS - 1; n++) {
            const double off = distance(is[n], wanted[n], 0.1 * limits[n]);
            worst = off > worst ? off : worst;
        }
        words += is[COMMAND_COLUMNS - 1] != wanted[COMMAND_COLUMNS - 1];
        count_steered(&command);
        count++;
    }
    const long left_out = lines_left(file);
    fclose(file);
    if (words && strict_status) {
        printf("%s: %ld status words differ\n", name, words);
    }
    return verdict(name, count, left_out, worst, command_allowed) || (words && strict_status);
}

/* In closed loop: the force on the glider and where it must be stand in each line. */
static int closed_loop(const char *name, const int rows)
{
    FILE *file = opened(name);
    double row[MAX_COLUMNS], worst = 0.0;
    long count = 0;
    glider_state state;
    plant_state afloat, seen;
    glider_init(&state);
    plant_init(&afloat);
    while (count < (long)rows * HOLD && read_line(file, row, CLOSED_COLUMNS)) {
        plant_force force;
        read_force(row, &force);
        for (int n = 0; n < HOLD; n++) {
            glider_measurement measurement;
            glider_reference reference;
            glider_command command;
            plant_command wanted;
            plant_seen(&afloat, &seen);
            measure(&seen, (double)count * GLIDER_DT, &measurement);
            glider_plan(&state, &measurement, &reference);
            glider_step(&state, &measurement, &reference, &command);
            steer(&command, &wanted);
            count_steered(&command);
            plant_step(&afloat, &wanted, &force);
            count++;
        }
        double is[STATE_COLUMNS];
        write_state(&afloat, is);
        for (int n = 0; n < STATE_COLUMNS; n++) {
            const double off = distance(is[n], row[FORCE_COLUMNS + n], 1.0);
            worst = off > worst ? off : worst;
        }
    }
    const long left_out = HOLD * lines_left(file);
    fclose(file);
    return verdict(name, count, left_out, worst, state_allowed);
}

int main(void)
{
#ifdef GLIDER_FLOAT
    const int strict = 0;
#else
    const int strict = 1;
#endif
    int failed = ticks("test/vectors.csv", ROWS(VECTORS), strict);
#ifndef GLIDER_FLOAT
    failed |= ticks("test/faults.csv", ROWS(FAULTS), strict);
#endif
    failed |= closed_loop("test/closed_loop.csv", ROWS(CLOSED_LOOP));
    return failed;
}
