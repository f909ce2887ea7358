/* The exported controller as a program for software in the loop: one line of numbers in,
   one line out. README.md describes the protocol. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "glider.h"

#define VERSION "jaxglider-sil 1"
#define MAX_LINE 4096

static int numbers(char *line, double *row, const int count)
{
    char *at = line;
    for (int n = 0; n < count; n++) {
        char *end = at;
        row[n] = strtod(at, &end);
        if (end == at) {
            return 0;
        }
        at = end;
    }
    return at[strspn(at, " \t\r\n")] == '\0';
}

static int refuse(const char *text)
{
    printf("error %s\n", text);
    fflush(stdout);
    return 2;
}

int main(void)
{
    char line[MAX_LINE];
    double row[13];
    glider_state state;
    if (fgets(line, sizeof line, stdin) == NULL) {
        return 0;
    }
    const size_t length = strlen(VERSION);
    if (strncmp(line, VERSION, length) != 0 || !numbers(line + length, row, 1)) {
        return refuse("expected: " VERSION " DT");
    }
    if (fabs(row[0] - GLIDER_DT) > 1e-9 * GLIDER_DT) {
        printf("error this controller was exported for a tick of %.17g s\n", GLIDER_DT);
        fflush(stdout);
        return 2;
    }
    printf("ready\n");
    fflush(stdout);
    glider_init(&state);
    while (fgets(line, sizeof line, stdin) != NULL) {
        glider_measurement m;
        glider_reference reference;
        glider_command command;
        if (!numbers(line, row, 13)) {
            return refuse("expected 13 numbers in a line");
        }
        m.time = (glider_real)row[0];
        m.north = row[1];
        m.east = row[2];
        m.depth = (glider_real)row[3];
        m.roll = (glider_real)row[4];
        m.pitch = (glider_real)row[5];
        m.heading = (glider_real)row[6];
        m.surge = (glider_real)row[7];
        m.sway = (glider_real)row[8];
        m.heave = (glider_real)row[9];
        m.roll_rate = (glider_real)row[10];
        m.pitch_rate = (glider_real)row[11];
        m.yaw_rate = (glider_real)row[12];
        glider_plan(&state, &m, &reference);
        glider_step(&state, &m, &reference, &command);
        printf("%.17g %.17g %.17g %ld\n", (double)command.buoyancy_mass,
               (double)command.mass_position, (double)command.mass_angle,
               (long)command.status);
        fflush(stdout);
    }
    return 0;
}
