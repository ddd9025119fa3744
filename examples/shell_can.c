/* A closed can between two plates, of which the upper one comes down: the wall folds. Writes the surface
   of every tenth step as OBJ and prints one number a line. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "formats.h"
#include "program.h"
#include "shell_grid.h"

static const double pi = 3.14159265358979323846;
static const double radius = 0.033, height = 0.115, thickness = 0.0008;

static int failed(dgfem_status status) {
    if (status) fprintf(stderr, "%s\n", dgfem_status_text(status));
    return status != DGFEM_OK;
}

static dgfem_vec3 point(double x, double y, double z) {
    dgfem_vec3 p;
    p.x = (dgfem_real)x, p.y = (dgfem_real)y, p.z = (dgfem_real)z;
    return p;
}

/* ---- mesh: a wall, and two lids of a square with a ring around it; all normals point outward ---- */

static dgfem_vec3 wall(void *user, double u, double v) {
    double a = 2 * pi * (u - 0.125);
    (void)user;
    return point(radius * cos(a), radius * sin(a), height * v);
}

/* A point of a lid, which is domed inward: only its rim touches the plate. */
static dgfem_vec3 lid(double x, double y, double z) {
    double dome = 0.005 * (1 - (x * x + y * y) / (radius * radius));
    return point(x, y, z > 0 ? z - dome : z + dome);
}

/* A square inside; the user is the height of the rim. */
static dgfem_vec3 square(void *user, double u, double v) {
    double z = *(const double *)user, size = 0.45 * radius;
    if (z > 0) return lid(size * (2 * u - 1), size * (2 * v - 1), z);
    return lid(size * (2 * v - 1), size * (2 * u - 1), z);
}

/* From the circle (v = 0 above) to the square: u runs along the wall's, from one corner of the square to itself. */
static dgfem_vec3 ring(void *user, double u, double v) {
    double z = *(const double *)user, inward = z > 0 ? v : 1 - v, along = 4 * u;
    int side = along >= 4 ? 3 : (int)along;
    double t = 2 * (along - side) - 1, x = side == 0 ? 1 : side == 1 ? -t : side == 2 ? -1 : t;
    double y = side == 0 ? t : side == 1 ? 1 : side == 2 ? -t : -1, size = 0.45 * radius * inward;
    dgfem_vec3 rim = wall(NULL, u, 0);
    return lid((1 - inward) * (double)rim.x + size * x, (1 - inward) * (double)rim.y + size * y, z);
}

static int add_lid(shell_grid *grid, int n, double z) {
    int layers = n / 2 > 0 ? n / 2 : 1;
    return shell_grid_add(grid, 4 * n, layers, 0, 1e-6, ring, &z) && shell_grid_add(grid, n, n, 0, 1e-6, square, &z);
}

/* n elements along a quarter of the wall. */
static dgfem_shell *make_can(int n) {
    dgfem_shell_desc desc = dgfem_default_shell_desc();
    dgfem_shell *shell = NULL;
    shell_grid grid;
    memset(&grid, 0, sizeof grid);
    desc.material.young = (dgfem_real)2e8;
    desc.material.density = 2700;
    desc.thickness = (dgfem_real)thickness;
    desc.damping_mass = 100;
    desc.damping_stiffness = (dgfem_real)2e-5;
    desc.step_iterations = 6;
    desc.hooks = program_hooks();
    if (shell_grid_add(&grid, 4 * n, 4 * n, 0, 1e-6, wall, NULL) && add_lid(&grid, n, 0) && add_lid(&grid, n, height)) {
        shell_grid_describe(&grid, &desc);
        (void)failed(dgfem_shell_create(&desc, &shell));
    }
    shell_grid_free(&grid);
    return shell;
}

/* Not quite round. */
static void dent(dgfem_shell *shell) {
    unsigned seed = 7;
    for (int i = 0; i < shell->node_count; i++) {
        seed = seed * 1664525u + 1013904223u;
        dgfem_real r = (dgfem_real)(1 + 2e-4 * ((double)(seed >> 8) / 16777216 - 0.5));
        shell->position[i].x *= r, shell->position[i].y *= r;
    }
}

/* ---- what is told ---- */

/* Volume inside the middle surface; with a folder its two sides as OBJ too. -1 on failure. */
static double look(const dgfem_shell *shell, const char *folder, int frame) {
    dgfem_shell_surface_desc desc = dgfem_default_shell_surface_desc();
    dgfem_shell_surface *surface;
    double volume = 0;
    desc.subdivision = 3;
    desc.sides = 1;
    if (failed(dgfem_shell_surface_create(shell, &desc, &surface))) return -1;
    for (int t = 0; t < surface->triangle_count; t++) {
        dgfem_vec3 x[3];
        for (int k = 0; k < 3; k++) x[k] = surface->positions[surface->triangles[3 * t + k]];
        volume += (double)(x[0].x * (x[1].y * x[2].z - x[1].z * x[2].y) + x[0].y * (x[1].z * x[2].x - x[1].x * x[2].z) +
                           x[0].z * (x[1].x * x[2].y - x[1].y * x[2].x)) /
                  6;
    }
    if (folder) {
        formats_error error;
        char path[1024];
        snprintf(path, sizeof path, "%s/can_%04d.obj", folder, frame);
        if (!formats_write_obj(path, dgfem_points_in_vec3(surface->positions, surface->vertex_count),
                               dgfem_points_in_vec3(surface->normals, surface->vertex_count), surface->triangles,
                               surface->triangle_count, &error)) {
            fprintf(stderr, "%s\n", error.text);
            volume = -1;
        }
    }
    dgfem_shell_surface_destroy(surface);
    return volume;
}

/* ---- main ---- */

static int add_plates(dgfem_shell *shell, dgfem_shape_desc *upper, double speed, int *id) {
    dgfem_shape_desc lower = dgfem_default_shape_desc();
    lower.friction = 1;
    *upper = lower;
    lower.plane.normal = point(0, 0, 1), lower.plane.offset = (dgfem_real)(-thickness / 2);
    upper->plane.normal = point(0, 0, -1), upper->plane.offset = (dgfem_real)(-height - thickness / 2);
    upper->velocity = point(0, 0, -speed);
    return !failed(dgfem_shell_add_plane(shell, &lower, NULL)) && !failed(dgfem_shell_add_plane(shell, upper, id));
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv, "shell_can [--n N] [--depth D] [--seconds T] [--dt H] [--out FOLDER]");
    int n = program_int(&p, "--n", 4, 1, 60), upper, iterations = 0;
    double depth = program_real(&p, "--depth", 0.02), seconds = program_real(&p, "--seconds", 0.05);
    double dt = program_real(&p, "--dt", 0.0005);
    const char *folder = program_text(&p, "--out", NULL);
    dgfem_shape_desc plate;
    dgfem_shell_info info;
    program_end(&p);
    if (!(dt > 0) || !(seconds >= dt)) return fprintf(stderr, "--seconds needs a step\n"), 1;
    int steps = (int)(seconds / dt + 0.5);
    dgfem_shell *shell = make_can(n);
    if (!shell || !add_plates(shell, &plate, depth / seconds, &upper)) return 1;
    double before = look(shell, NULL, 0), after = before, start = program_seconds(), highest = 0;
    dent(shell);
    for (int step = 1; step <= steps; step++) {
        plate.plane.offset = (dgfem_real)(depth * step / steps - height - thickness / 2);
        if (failed(dgfem_shell_move_shape(shell, upper, &plate))) return 1;
        if (failed(dgfem_shell_step(shell, (dgfem_real)dt, &info))) return 1;
        iterations += info.iterations;
        if (step % 10 == 0 || step == steps) after = look(shell, folder, step / 10);
        if (after < 0) return 1;
    }
    for (int i = 0; i < shell->node_count; i++) highest = fmax(highest, (double)shell->position[i].z);
    printf(
        "nodes %d\nelements %d\nboundary_loops %d\nheight %.6g\nvolume_before %.6g\nvolume_after %.6g\ncontacts %d\n",
        shell->node_count, shell->element_count, dgfem_shell_boundary(shell, NULL, NULL), highest, before, after,
        info.contacts);
    printf("steps %d\niterations %d\nmilliseconds_per_step %.2f\n", steps, iterations,
           1e3 * (program_seconds() - start) / steps);
    dgfem_shell_destroy(shell);
    return 0;
}
