/* A cylinder under axial compression, as in the report: 31 x 31 quadrilaterals, 2945 nodes, 8835 unknowns. First the
   load at which the uniform state loses its stability, beside the classical one; then its ends are driven together in
   time, and it folds into dimples. Prints one number a line; --out FOLDER writes the surface as OBJ files, --csv the
   load over the shortening. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "formats.h"
#include "program.h"
#include "shell_grid.h"

static const double pi = 3.14159265358979323846;
static const double radius = 1, height = 2;

typedef struct buckling {
    dgfem_shell *shell;
    double thickness;
    int lower, upper; /* conditions of the ends */
    int *bottom, *top, bottom_count, top_count;
    int around, along;
} buckling;

static int failed(dgfem_status status) {
    if (status) fprintf(stderr, "%s\n", dgfem_status_text(status));
    return status != DGFEM_OK;
}

static dgfem_vec3 point(double x, double y, double z) {
    dgfem_vec3 p;
    p.x = (dgfem_real)x, p.y = (dgfem_real)y, p.z = (dgfem_real)z;
    return p;
}

static dgfem_vec3 tube(void *user, double u, double v) {
    (void)user;
    return point(radius * cos(2 * pi * u), radius * sin(2 * pi * u), height * v);
}

static int find_end(dgfem_shell *shell, double z, int **nodes) {
    dgfem_plane plane;
    plane.normal = point(0, 0, 1), plane.offset = (dgfem_real)z;
    int count = dgfem_shell_nodes_on_plane(shell, plane, (dgfem_real)1e-4, NULL, 0);
    *nodes = (int *)malloc((size_t)(count ? count : 1) * sizeof(int));
    return *nodes ? dgfem_shell_nodes_on_plane(shell, plane, (dgfem_real)1e-4, *nodes, count) : 0;
}

static int create(buckling *b, double eta) {
    shell_grid grid;
    dgfem_shell_desc desc = dgfem_default_shell_desc();
    memset(&grid, 0, sizeof grid);
    if (!shell_grid_add(&grid, b->around, b->along, 0, 1e-5, tube, NULL)) return 0;
    shell_grid_describe(&grid, &desc);
    desc.material.young = (dgfem_real)1e9;
    desc.material.poisson = (dgfem_real)0.3;
    desc.material.density = 1000;
    desc.thickness = (dgfem_real)b->thickness;
    desc.eta_quad = (dgfem_real)eta;
    desc.gravity = point(0, 0, 0);
    desc.damping_mass = 5;
    desc.damping_stiffness = (dgfem_real)2e-5;
    desc.step_iterations = 8;
    desc.hooks = program_hooks();
    dgfem_status status = dgfem_shell_create(&desc, &b->shell);
    shell_grid_free(&grid);
    if (failed(status)) return 0;
    b->bottom_count = find_end(b->shell, 0, &b->bottom);
    b->top_count = find_end(b->shell, height, &b->top);
    return !failed(dgfem_shell_fix_nodes(b->shell, b->bottom, b->bottom_count, DGFEM_SHELL_XYZ, point(0, 0, 0),
                                         &b->lower)) &&
           !failed(dgfem_shell_fix_nodes(b->shell, b->top, b->top_count, DGFEM_SHELL_XYZ, point(0, 0, 0), &b->upper));
}

/* The uniform state of this axial strain: free to widen, so that there is axial force only. */
static void compress_uniformly(buckling *b, double strain) {
    double wider = 1 + (double)b->shell->desc.material.poisson * strain;
    for (int i = 0; i < b->shell->node_count; i++) {
        dgfem_vec3 x = b->shell->rest[i];
        b->shell->position[i] = point(wider * (double)x.x, wider * (double)x.y, (1 - strain) * (double)x.z);
    }
}

static double classical_strain(const buckling *b) {
    double nu = (double)b->shell->desc.material.poisson;
    return b->thickness / (radius * sqrt(3 * (1 - nu * nu)));
}

/* Axial strain at which the tangent stiffness stops being positive definite. */
static int bifurcation(buckling *b, double *strain) {
    double low = 0.5 * classical_strain(b), high = 1.5 * classical_strain(b);
    for (int k = 0; k < 12; k++) {
        int stable;
        *strain = 0.5 * (low + high);
        compress_uniformly(b, *strain);
        if (failed(dgfem_shell_is_stable(b->shell, &stable))) return 0;
        if (stable) low = *strain;
        else high = *strain;
    }
    compress_uniformly(b, 0);
    return 1;
}

/* Axial force on the upper end. */
static double load(const buckling *b, dgfem_vec3 *force) {
    double sum = 0;
    if (failed(dgfem_shell_internal_force(b->shell, force))) return NAN;
    for (int i = 0; i < b->top_count; i++) sum -= (double)force[b->top[i]].z;
    return sum;
}

/* Dimples: local minima of the distance from the axis, among points on a lattice, that lie inward by half a thickness.
   */
static int count_dimples(const buckling *b) {
    enum { U = 124, V = 62 };
    static double depth[U][V + 1];
    int dimples = 0;
    for (int i = 0; i < U; i++)
        for (int j = 0; j <= V; j++) {
            double u = (double)i / U * b->around, v = (double)j / V * b->along * 0.9999;
            int e = (int)u + b->around * (int)v;
            dgfem_vec3 x = point(0, 0, 0);
            (void)dgfem_shell_evaluate(b->shell, e, (dgfem_real)(2 * (u - floor(u)) - 1),
                                       (dgfem_real)(2 * (v - floor(v)) - 1), &x, NULL);
            depth[i][j] = radius - hypot((double)x.x, (double)x.y);
        }
    for (int i = 0; i < U; i++)
        for (int j = 2; j <= V - 2; j++) {
            int deepest = depth[i][j] > 0.5 * b->thickness;
            for (int p = -3; p <= 3; p++)
                for (int q = -2; q <= 2; q++) {
                    double other = depth[(i + p + U) % U][j + q];
                    if ((p || q) && (other > depth[i][j] || (other == depth[i][j] && (p > 0 || (p == 0 && q > 0)))))
                        deepest = 0;
                }
            dimples += deepest;
        }
    return dimples;
}

static int write_frame(const buckling *b, const char *folder, int frame) {
    dgfem_shell_surface_desc desc = dgfem_default_shell_surface_desc();
    dgfem_shell_surface *surface;
    formats_error error;
    char path[1024];
    desc.subdivision = 4;
    if (failed(dgfem_shell_surface_create(b->shell, &desc, &surface))) return 0;
    snprintf(path, sizeof path, "%s/buckling_%04d.obj", folder, frame);
    int written = formats_write_obj(path, dgfem_points_in_vec3(surface->positions, surface->vertex_count),
                                    dgfem_points_in_vec3(surface->normals, surface->vertex_count), surface->triangles,
                                    surface->triangle_count, &error);
    dgfem_shell_surface_destroy(surface);
    if (!written) fprintf(stderr, "%s\n", error.text);
    return written;
}

/* A repeatable small noise, so that no symmetry holds the cylinder up. */
static void disturb(buckling *b, double size) {
    unsigned seed = 1;
    for (int i = 0; i < b->shell->node_count; i++) {
        seed = seed * 1664525u + 1013904223u;
        double r = size * ((double)(seed >> 8) / 16777216 - 0.5);
        dgfem_vec3 x = b->shell->rest[i];
        b->shell->position[i] = point((double)x.x * (1 + r), (double)x.y * (1 + r), (double)x.z);
    }
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "shell_buckling [--around N] [--along N] [--thickness H] [--eta E] [--shortening S] "
                              "[--seconds T] [--dt H] [--out FOLDER] [--csv FILE]");
    buckling b;
    memset(&b, 0, sizeof b);
    b.around = program_int(&p, "--around", 31, 3, 400);
    b.along = program_int(&p, "--along", 31, 1, 400);
    b.thickness = program_real(&p, "--thickness", 0.02);
    double eta = program_real(&p, "--eta", 2), shortening = program_real(&p, "--shortening", 0.03);
    double seconds = program_real(&p, "--seconds", 0.04), dt = program_real(&p, "--dt", 0.0004);
    const char *folder = program_text(&p, "--out", NULL), *csv = program_text(&p, "--csv", NULL);
    program_end(&p);
    if (!create(&b, eta)) return 1;
    printf("elements %d\nnodes %d\ndofs %d\n", b.shell->element_count, b.shell->node_count, 3 * b.shell->node_count);

    /* The classical bifurcation. */
    double critical, start = program_seconds(), peak = 0, now = 0;
    double classical = classical_strain(&b) * 2 * pi * radius * b.thickness * (double)b.shell->desc.material.young;
    if (!bifurcation(&b, &critical)) return 1;
    printf("classical_load %.6g\nbifurcation_load %.6g\nbifurcation_normalised %.4f\n", classical,
           classical * critical / classical_strain(&b), critical / classical_strain(&b));
    printf("milliseconds_bifurcation %.0f\n", 1e3 * (program_seconds() - start));

    /* Driven together. */
    dgfem_vec3 *force = (dgfem_vec3 *)malloc((size_t)b.shell->node_count * sizeof *force);
    FILE *table = csv ? fopen(csv, "w") : NULL;
    program_progress progress;
    int steps = (int)(seconds / dt + 0.5), iterations = 0, shifts = 0;
    if (!force) return 1;
    memset(&progress, 0, sizeof progress);
    disturb(&b, 0.02 * b.thickness);
    start = program_seconds();
    for (int step = 1; step <= steps; step++) {
        dgfem_shell_info info;
        double s = shortening * step / steps;
        if (failed(dgfem_shell_move_fixture(b.shell, b.upper, point(0, 0, -s * height)))) return 1;
        if (failed(dgfem_shell_step(b.shell, (dgfem_real)dt, &info))) return 1;
        now = load(&b, force);
        if (now > peak) peak = now;
        iterations += info.iterations, shifts += info.shifts;
        if (table)
            fflush(table), fprintf(table, "%g,%g,%d,%g\n", s, now / classical, info.iterations, (double)info.residual);
        if (folder && (step == steps || step % 20 == 0) && !write_frame(&b, folder, step / 20)) return 1;
        program_show_progress(&progress, step, steps, NULL);
    }
    program_end_progress(&progress);
    if (table) fclose(table);
    printf("steps %d\niterations %d\nshifts %d\nmilliseconds_per_step %.1f\n", steps, iterations, shifts,
           1e3 * (program_seconds() - start) / steps);
    printf("peak_load_normalised %.4f\nfinal_load_normalised %.4f\nfinal_by_peak %.4f\ndimples %d\n", peak / classical,
           now / classical, now / peak, count_dimples(&b));
    free(force);
    free(b.bottom), free(b.top);
    dgfem_shell_destroy(b.shell);
    return 0;
}
