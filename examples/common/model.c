#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

/* Latitudes and longitudes. */
int model_make(formats_surface *surface) {
    enum { RINGS = 30, SECTORS = 60 };
    const double pi = 3.14159265358979323846;
    int n = 0;
    memset(surface, 0, sizeof *surface);
    surface->vertex_count = (RINGS - 1) * SECTORS + 2;
    surface->vertices = (double *)malloc((size_t)surface->vertex_count * 3 * sizeof(double));
    surface->triangles = (int *)malloc((size_t)(2 * (RINGS - 1) * SECTORS) * 3 * sizeof(int));
    if (!surface->vertices || !surface->triangles) return formats_free_surface(surface), 0;
    for (int v = 0; v < surface->vertex_count; v++) {
        int is_pole = v >= (RINGS - 1) * SECTORS;
        double polar = is_pole ? (v == surface->vertex_count - 1 ? pi : 0) : pi * (v / SECTORS + 1) / RINGS;
        double around = is_pole ? 0 : 2 * pi * (v % SECTORS) / SECTORS;
        double horn = exp(-40 * ((polar - 0.7) * (polar - 0.7) + cos(around) * cos(around)));
        double r = 1 + 0.2 * pow(sin(polar), 5) * cos(5 * around) + 0.8 * horn;
        surface->vertices[3 * v] = r * sin(polar) * cos(around);
        surface->vertices[3 * v + 2] = r * sin(polar) * sin(around);
        surface->vertices[3 * v + 1] = r * cos(polar);
    }
    for (int ring = -1; ring < RINGS - 1; ring++)
        for (int s = 0; s < SECTORS; s++) {
            int north = (RINGS - 1) * SECTORS, south = north + 1, next = (s + 1) % SECTORS;
            int a = ring < 0 ? north : ring * SECTORS + s, b = ring < 0 ? north : ring * SECTORS + next;
            int c = ring == RINGS - 2 ? south : (ring + 1) * SECTORS + s;
            int d = ring == RINGS - 2 ? south : (ring + 1) * SECTORS + next;
            int corners[2][3] = {{a, b, d}, {a, d, c}};
            for (int t = 0; t < 2; t++)
                if (corners[t][0] != corners[t][1] && corners[t][1] != corners[t][2] && corners[t][0] != corners[t][2])
                    memcpy(surface->triangles + 3 * n++, corners[t], sizeof corners[t]);
        }
    surface->triangle_count = n;
    return 1;
}

static void stand_up(formats_surface *surface) {
    double lower[3] = {1e300, 1e300, 1e300}, upper[3] = {-1e300, -1e300, -1e300};
    for (int v = 0; v < surface->vertex_count; v++) {
        double *x = surface->vertices + 3 * v, y = x[1];
        x[1] = -x[2], x[2] = y;
        for (int k = 0; k < 3; k++) lower[k] = fmin(lower[k], x[k]), upper[k] = fmax(upper[k], x[k]);
    }
    double scale = 1 / (upper[2] - lower[2]);
    for (int v = 0; v < surface->vertex_count; v++) {
        double *x = surface->vertices + 3 * v;
        x[0] = (x[0] - (lower[0] + upper[0]) / 2) * scale;
        x[1] = (x[1] - (lower[1] + upper[1]) / 2) * scale;
        x[2] = (x[2] - lower[2]) * scale;
    }
}

int model_read(const char *path, formats_surface *out) {
    formats_error error;
    memset(out, 0, sizeof *out);
    snprintf(error.text, sizeof error.text, "out of memory");
    if (!path) printf("no model given: a built-in shape it is\n");
    if (!(path ? formats_read_surface(path, out, &error) : model_make(out))) {
        fprintf(stderr, "%s\n", error.text);
        return 0;
    }
    stand_up(out);
    return 1;
}

void model_vertex_areas(const formats_surface *surface, dgfem_real *areas) {
    for (int v = 0; v < surface->vertex_count; v++) areas[v] = 0;
    for (int t = 0; t < surface->triangle_count; t++) {
        const int *corner = surface->triangles + 3 * t;
        const double *a = surface->vertices + 3 * corner[0], *b = surface->vertices + 3 * corner[1];
        const double *c = surface->vertices + 3 * corner[2];
        double u[3], v[3];
        for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k];
        double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
        for (int k = 0; k < 3; k++) areas[corner[k]] += (dgfem_real)(sqrt(x * x + y * y + z * z) / 6);
    }
}
