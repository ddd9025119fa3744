/* A sheet hung by one side swings, is slit twice while it moves, and is torn off in the end; or, with --can, a can is
   crushed between two plates. Writes the surface of every tenth step as OBJ and prints one number a line. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "formats.h"
#include "program.h"
#include "shell_grid.h"

static const double pi = 3.14159265358979323846;

static int failed(dgfem_status status) {
    if (status) fprintf(stderr, "%s\n", dgfem_status_text(status));
    return status != DGFEM_OK;
}

static dgfem_vec3 point(double x, double y, double z) {
    dgfem_vec3 p;
    p.x = (dgfem_real)x, p.y = (dgfem_real)y, p.z = (dgfem_real)z;
    return p;
}

static dgfem_vec3 sheet_map(void *user, double u, double v) {
    (void)user;
    return point(u, 0.3 * v, 0);
}

/* The wall of a can. */
static dgfem_vec3 can_map(void *user, double u, double v) {
    double a = 2 * pi * u, r = 0.033, h = 0.115;
    (void)user;
    return point(r * cos(a), r * sin(a), h * v);
}

static dgfem_shell *make(shell_grid_map map, int nu, int nv, int triangles, const dgfem_shell_desc *desc) {
    shell_grid grid;
    dgfem_shell_desc full = *desc;
    dgfem_shell *shell = NULL;
    memset(&grid, 0, sizeof grid);
    if (!shell_grid_add(&grid, nu, nv, triangles, 1e-6, map, NULL)) return NULL;
    shell_grid_describe(&grid, &full);
    (void)failed(dgfem_shell_create(&full, &shell));
    shell_grid_free(&grid);
    return shell;
}

static int write_frame(const dgfem_shell *shell, const char *folder, const char *name, int frame) {
    dgfem_shell_surface_desc desc = dgfem_default_shell_surface_desc();
    dgfem_shell_surface *surface;
    formats_error error;
    char path[1024];
    desc.subdivision = 3;
    if (!folder) return 1;
    if (failed(dgfem_shell_surface_create(shell, &desc, &surface))) return 0;
    snprintf(path, sizeof path, "%s/%s_%04d.obj", folder, name, frame);
    int written = formats_write_obj(path, dgfem_points_in_vec3(surface->positions, surface->vertex_count),
                                    dgfem_points_in_vec3(surface->normals, surface->vertex_count), surface->triangles,
                                    surface->triangle_count, &error);
    dgfem_shell_surface_destroy(surface);
    if (!written) fprintf(stderr, "%s\n", error.text);
    return written;
}

static int fix_plane(dgfem_shell *shell, dgfem_plane plane, int axes, int *id) {
    int count = dgfem_shell_nodes_on_plane(shell, plane, (dgfem_real)1e-6, NULL, 0);
    int *nodes = (int *)malloc((size_t)(count ? count : 1) * sizeof(int));
    if (!nodes) return 0;
    dgfem_shell_nodes_on_plane(shell, plane, (dgfem_real)1e-6, nodes, count);
    dgfem_status status = dgfem_shell_fix_nodes(shell, nodes, count, axes, point(0, 0, 0), id);
    free(nodes);
    return !failed(status);
}

/* A slit across the sheet at x, from one side to `until`. */
static int slit(dgfem_shell *shell, double x, double from, double until, dgfem_shell_cut_info *info) {
    dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
    cut.current = 0;
    cut.plane.normal = point(1, 0.4, 0);
    cut.plane.offset = (dgfem_real)x;
    cut.bounded = 1;
    cut.from = point(0, from, 0), cut.to = point(0, until, 0);
    return !failed(dgfem_shell_cut_plane(shell, &cut, info));
}

static int hanging_sheet(const char *folder, int n, double seconds, double dt) {
    dgfem_shell_desc desc = dgfem_default_shell_desc();
    dgfem_shell_cut_info cut;
    dgfem_shell_info info;
    dgfem_plane side;
    int steps = (int)(seconds / dt + 0.5), iterations = 0, worst = 0;
    desc.material.young = (dgfem_real)1e7;
    desc.thickness = (dgfem_real)0.001;
    desc.damping_mass = 1;
    desc.damping_stiffness = (dgfem_real)0.002;
    desc.hooks = program_hooks();
    dgfem_shell *shell = make(sheet_map, n, n / 3 > 0 ? n / 3 : 1, 0, &desc);
    if (!shell) return 0;
    side.normal = point(1, 0, 0), side.offset = 0;
    if (!fix_plane(shell, side, DGFEM_SHELL_XYZ, NULL)) return 0;
    memset(&cut, 0, sizeof cut);
    double start = program_seconds();
    for (int step = 1; step <= steps; step++) {
        if (step == steps / 2 && !slit(shell, 0.45, -0.01, 0.18, &cut)) return 0;
        if (step == steps * 5 / 8 && !slit(shell, 0.7, 0.1, 0.31, &cut)) return 0;
        if (step == steps * 7 / 8 && !slit(shell, 0.45, 0.1, 0.31, &cut)) return 0;
        if (failed(dgfem_shell_step(shell, (dgfem_real)dt, &info))) return 0;
        iterations += info.iterations;
        worst = info.iterations > worst ? info.iterations : worst;
        if ((step % 10 == 0 || step == steps) && !write_frame(shell, folder, "sheet", step / 10)) return 0;
    }
    printf("nodes %d\nelements %d\npieces %d\narea %.15g\nsteps %d\niterations %d\nmilliseconds_per_step %.2f\n",
           shell->node_count, shell->element_count, cut.pieces, (double)dgfem_shell_area(shell), steps, iterations,
           1e3 * (program_seconds() - start) / steps);
    dgfem_shell_destroy(shell);
    return 1;
}

static int crushed_can(const char *folder, int n, double seconds, double dt) {
    dgfem_shell_desc desc = dgfem_default_shell_desc();
    dgfem_shape_desc plate = dgfem_default_shape_desc();
    dgfem_shell_info info;
    int steps = (int)(seconds / dt + 0.5), iterations = 0, upper;
    const double depth = 0.02, height = 0.115;
    dgfem_plane end;
    desc.material.young = (dgfem_real)2e8;
    desc.material.density = 2700;
    desc.thickness = (dgfem_real)0.0008;
    desc.damping_mass = 100;
    desc.damping_stiffness = (dgfem_real)2e-5;
    desc.step_iterations = 6;
    desc.hooks = program_hooks();
    dgfem_shell *shell = make(can_map, n, n, 0, &desc);
    if (!shell) return 0;
    end.normal = point(0, 0, 1), end.offset = 0; /* the lids keep the ends round */
    if (!fix_plane(shell, end, DGFEM_SHELL_X + DGFEM_SHELL_Y, NULL)) return 0;
    end.offset = (dgfem_real)height;
    if (!fix_plane(shell, end, DGFEM_SHELL_X + DGFEM_SHELL_Y, NULL)) return 0;
    plate.plane.normal = point(0, 0, 1), plate.plane.offset = (dgfem_real)-0.0004;
    plate.friction = 1;
    if (failed(dgfem_shell_add_plane(shell, &plate, NULL))) return 0;
    plate.plane.normal = point(0, 0, -1);
    plate.velocity = point(0, 0, -depth / seconds);
    plate.plane.offset = (dgfem_real)(-height - 0.0004);
    if (failed(dgfem_shell_add_plane(shell, &plate, &upper))) return 0;
    unsigned seed = 7;
    for (int i = 0; i < shell->node_count; i++) { /* not quite round */
        seed = seed * 1664525u + 1013904223u;
        dgfem_real r = (dgfem_real)(1 + 2e-4 * ((double)(seed >> 8) / 16777216 - 0.5));
        shell->position[i].x *= r, shell->position[i].y *= r;
    }
    double start = program_seconds();
    for (int step = 1; step <= steps; step++) {
        plate.plane.offset = (dgfem_real)(depth * step / steps - height - 0.0004);
        if (failed(dgfem_shell_move_shape(shell, upper, &plate))) return 0;
        if (failed(dgfem_shell_step(shell, (dgfem_real)dt, &info))) return 0;
        iterations += info.iterations;
        if ((step % 10 == 0 || step == steps) && !write_frame(shell, folder, "can", step / 10)) return 0;
    }
    double highest = 0;
    for (int i = 0; i < shell->node_count; i++) highest = fmax(highest, (double)shell->position[i].z);
    printf("nodes %d\nelements %d\nheight %.6g\ncontacts %d\nsteps %d\niterations %d\nmilliseconds_per_step %.2f\n",
           shell->node_count, shell->element_count, highest, info.contacts, steps, iterations,
           1e3 * (program_seconds() - start) / steps);
    dgfem_shell_destroy(shell);
    return 1;
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv, "shell_sheet [--can] [--n N] [--seconds T] [--dt H] [--out FOLDER]");
    int can = program_flag(&p, "--can"), n = program_int(&p, "--n", can ? 20 : 12, 3, 200);
    double seconds = program_real(&p, "--seconds", can ? 0.05 : 1.6),
           dt = program_real(&p, "--dt", can ? 0.0005 : 0.01);
    const char *folder = program_text(&p, "--out", NULL);
    program_end(&p);
    if (!(dt > 0) || !(seconds >= 8 * dt)) return fprintf(stderr, "--seconds needs eight steps\n"), 1;
    return !(can ? crushed_can(folder, n, seconds, dt) : hanging_sheet(folder, n, seconds, dt));
}
