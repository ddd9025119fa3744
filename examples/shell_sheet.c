/* A sheet hung by one side swings, is slit twice while it moves, and is torn off in the end. Writes the surface of
   every tenth step as OBJ and prints one number a line. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "formats.h"
#include "program.h"
#include "shell_grid.h"

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

static dgfem_shell *make(int nu, int nv, const dgfem_shell_desc *desc) {
    shell_grid grid;
    dgfem_shell_desc full = *desc;
    dgfem_shell *shell = NULL;
    memset(&grid, 0, sizeof grid);
    if (!shell_grid_add(&grid, nu, nv, 0, 0, sheet_map, NULL)) return NULL;
    shell_grid_describe(&grid, &full);
    (void)failed(dgfem_shell_create(&full, &shell));
    shell_grid_free(&grid);
    return shell;
}

static int write_frame(const dgfem_shell *shell, const char *folder, int frame) {
    dgfem_shell_surface_desc desc = dgfem_default_shell_surface_desc();
    dgfem_shell_surface *surface;
    formats_error error;
    char path[1024];
    desc.subdivision = 3;
    if (!folder) return 1;
    if (failed(dgfem_shell_surface_create(shell, &desc, &surface))) return 0;
    snprintf(path, sizeof path, "%s/sheet_%04d.obj", folder, frame);
    int written = formats_write_obj(path, dgfem_points_in_vec3(surface->positions, surface->vertex_count),
                                    dgfem_points_in_vec3(surface->normals, surface->vertex_count), surface->triangles,
                                    surface->triangle_count, &error);
    dgfem_shell_surface_destroy(surface);
    if (!written) fprintf(stderr, "%s\n", error.text);
    return written;
}

static int hang(dgfem_shell *shell) {
    dgfem_plane side;
    side.normal = point(1, 0, 0), side.offset = 0;
    int count = dgfem_shell_nodes_on_plane(shell, side, (dgfem_real)1e-6, NULL, 0);
    int *nodes = (int *)malloc((size_t)(count ? count : 1) * sizeof(int));
    if (!nodes) return 0;
    dgfem_shell_nodes_on_plane(shell, side, (dgfem_real)1e-6, nodes, count);
    dgfem_status status = dgfem_shell_fix_nodes(shell, nodes, count, DGFEM_SHELL_XYZ, point(0, 0, 0), NULL);
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
    int steps = (int)(seconds / dt + 0.5), iterations = 0, worst = 0;
    desc.material.young = (dgfem_real)1e7;
    desc.thickness = (dgfem_real)0.001;
    desc.damping_mass = 1;
    desc.damping_stiffness = (dgfem_real)0.002;
    desc.hooks = program_hooks();
    dgfem_shell *shell = make(n, n / 3 > 0 ? n / 3 : 1, &desc);
    if (!shell || !hang(shell)) return 0;
    memset(&cut, 0, sizeof cut);
    double start = program_seconds();
    for (int step = 1; step <= steps; step++) {
        if (step == steps / 2 && !slit(shell, 0.45, -0.01, 0.18, &cut)) return 0;
        if (step == steps * 5 / 8 && !slit(shell, 0.7, 0.1, 0.31, &cut)) return 0;
        if (step == steps * 7 / 8 && !slit(shell, 0.45, 0.1, 0.31, &cut)) return 0;
        if (failed(dgfem_shell_step(shell, (dgfem_real)dt, &info))) return 0;
        iterations += info.iterations;
        worst = info.iterations > worst ? info.iterations : worst;
        if ((step % 10 == 0 || step == steps) && !write_frame(shell, folder, step / 10)) return 0;
    }
    printf("nodes %d\nelements %d\npieces %d\narea %.15g\nsteps %d\niterations %d\nmilliseconds_per_step %.2f\n",
           shell->node_count, shell->element_count, cut.pieces, (double)dgfem_shell_area(shell), steps, iterations,
           1e3 * (program_seconds() - start) / steps);
    dgfem_shell_destroy(shell);
    return 1;
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv, "shell_sheet [--n N] [--seconds T] [--dt H] [--out FOLDER]");
    int n = program_int(&p, "--n", 12, 3, 200);
    double seconds = program_real(&p, "--seconds", 1.6), dt = program_real(&p, "--dt", 0.01);
    const char *folder = program_text(&p, "--out", NULL);
    program_end(&p);
    if (!(dt > 0) || !(seconds >= 8 * dt)) return fprintf(stderr, "--seconds needs eight steps\n"), 1;
    return !hanging_sheet(folder, n, seconds, dt);
}
