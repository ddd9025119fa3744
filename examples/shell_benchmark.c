/* Classical tests of shell elements: the obstacle course (Scordelis-Lo roof, pinched cylinder, pinched hemisphere with
   and without a hole), Kirchhoff's plates, and two of the large rotations of Sze, Liu and Lo (2004). Prints one number
   a line. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "program.h"
#include "shell_grid.h"

static const double pi = 3.14159265358979323846;

/* One test: the mesh, the material, what holds and loads it, what is measured. */
typedef struct benchmark {
    dgfem_shell *shell;
    dgfem_shell_desc desc;
    shell_grid grid;
    int n, triangles, probe, axis, load_steps;
    double sign, reference; /* of the displacement of node `probe` along the axis */
    int second_axis;        /* a second component, or -1 */
    double second_sign, second_reference;
} benchmark;

static int failed(dgfem_status status) {
    if (status) fprintf(stderr, "%s\n", dgfem_status_text(status));
    return status != DGFEM_OK;
}

static dgfem_vec3 point(double x, double y, double z) {
    dgfem_vec3 p;
    p.x = (dgfem_real)x, p.y = (dgfem_real)y, p.z = (dgfem_real)z;
    return p;
}

static dgfem_plane plane_at(double nx, double ny, double nz, double offset) {
    dgfem_plane plane;
    plane.normal = point(nx, ny, nz);
    plane.offset = (dgfem_real)offset;
    return plane;
}

/* ---- holding ---- */

/* All boundary edges, or nodes, on a plane; NULL when there are none. */
static int *on_plane(const dgfem_shell *shell, dgfem_plane plane, double size, int edges, int *count) {
    int (*find)(const dgfem_shell *, dgfem_plane, dgfem_real, int *, int) =
        edges ? dgfem_shell_edges_on_plane : dgfem_shell_nodes_on_plane;
    int *list;
    *count = find(shell, plane, (dgfem_real)(1e-5 * size), NULL, 0);
    list = (int *)malloc((size_t)(*count ? *count : 1) * sizeof(int));
    if (list) find(shell, plane, (dgfem_real)(1e-5 * size), list, *count);
    return list;
}

static int symmetry(benchmark *b, dgfem_plane plane, double size) {
    int count, *edges = on_plane(b->shell, plane, size, 1, &count);
    dgfem_status status = dgfem_shell_fix_symmetry(b->shell, edges, count, plane.normal, NULL);
    free(edges);
    return !failed(status);
}

static int fix(benchmark *b, dgfem_plane plane, double size, int axes) {
    int count, *nodes = on_plane(b->shell, plane, size, 0, &count);
    dgfem_status status = dgfem_shell_fix_nodes(b->shell, nodes, count, axes, point(0, 0, 0), NULL);
    free(nodes);
    return !failed(status);
}

static int clamp(benchmark *b, dgfem_plane plane, double size) {
    int count, *edges = on_plane(b->shell, plane, size, 1, &count);
    dgfem_status status = dgfem_shell_clamp(b->shell, edges, count, NULL);
    free(edges);
    return !failed(status);
}

static int push(benchmark *b, dgfem_vec3 at, dgfem_vec3 force) {
    int node = shell_grid_nearest(b->shell, (double)at.x, (double)at.y, (double)at.z);
    return !failed(dgfem_shell_add_force(b->shell, &node, 1, force, NULL));
}

static int create(benchmark *b) {
    shell_grid_describe(&b->grid, &b->desc);
    return !failed(dgfem_shell_create(&b->desc, &b->shell));
}

static int build(benchmark *b, int nu, int nv, shell_grid_map map) {
    return shell_grid_add(&b->grid, nu, nv, b->triangles, 0, map, b) && create(b);
}

static void material(benchmark *b, double young, double poisson, double thickness) {
    b->desc.material.young = (dgfem_real)young;
    b->desc.material.poisson = (dgfem_real)poisson;
    b->desc.material.density = 1;
    b->desc.thickness = (dgfem_real)thickness;
    b->desc.gravity = point(0, 0, 0);
}

static void measure(benchmark *b, dgfem_vec3 at, int axis, double sign, double reference) {
    b->probe = shell_grid_nearest(b->shell, (double)at.x, (double)at.y, (double)at.z);
    b->axis = axis, b->sign = sign, b->reference = reference;
}

/* ---- obstacle course ---- */

static dgfem_vec3 roof(void *user, double u, double v) {
    double a = u * 40 * pi / 180;
    (void)user;
    return point(25 * sin(a), 25 * v, 25 * cos(a));
}

static int scordelis(benchmark *b) {
    material(b, 4.32e8, 0, 0.25);
    b->desc.gravity = point(0, 0, -360); /* 90 per unit area */
    if (!build(b, b->n, b->n, roof)) return 0;
    measure(b, roof(NULL, 1, 1), 2, -1, 0.3024);
    return symmetry(b, plane_at(1, 0, 0, 0), 25) && symmetry(b, plane_at(0, 1, 0, 25), 25) &&
           fix(b, plane_at(0, 1, 0, 0), 25, DGFEM_SHELL_X + DGFEM_SHELL_Z);
}

/* The mesh (its user is the benchmark) runs backwards where it is of triangles: their diagonals then meet the load. */
static dgfem_vec3 tube(void *user, double u, double v) {
    const benchmark *mesh = (const benchmark *)user;
    if (mesh && mesh->triangles) u = 1 - u;
    return point(300 * sin(u * pi / 2), 300 * v, 300 * cos(u * pi / 2));
}

static int cylinder(benchmark *b) {
    material(b, 3e6, 0.3, 3);
    if (!build(b, b->n, b->n, tube)) return 0;
    measure(b, tube(NULL, 0, 1), 2, -1, 1.8248e-5);
    return symmetry(b, plane_at(1, 0, 0, 0), 300) && symmetry(b, plane_at(0, 0, 1, 0), 300) &&
           symmetry(b, plane_at(0, 1, 0, 300), 300) &&
           fix(b, plane_at(0, 1, 0, 0), 300, DGFEM_SHELL_X + DGFEM_SHELL_Z) &&
           push(b, tube(NULL, 0, 1), point(0, 0, -0.25));
}

static dgfem_vec3 dome(void *user, double u, double v) {
    double a = u * pi / 2, c = v * 72 * pi / 180;
    (void)user;
    return point(10 * cos(a) * cos(c), 10 * sin(a) * cos(c), 10 * sin(c));
}

static int pinch_dome(benchmark *b, double reference) {
    dgfem_vec3 x = point(10, 0, 0), y = point(0, 10, 0);
    int node = shell_grid_nearest(b->shell, 10, 0, 0);
    measure(b, x, 0, 1, reference);
    return symmetry(b, plane_at(0, 1, 0, 0), 10) && symmetry(b, plane_at(1, 0, 0, 0), 10) &&
           !failed(dgfem_shell_fix_nodes(b->shell, &node, 1, DGFEM_SHELL_Z, point(0, 0, 0), NULL)) &&
           push(b, x, point(1, 0, 0)) && push(b, y, point(0, -1, 0));
}

static int hemisphere(benchmark *b) {
    material(b, 6.825e7, 0.3, 0.04);
    return build(b, b->n, b->n, dome) && pinch_dome(b, 0.094);
}

/* A third of an octant: the quadrilateral of a corner, the middles of its two sides, and the centre. */
static dgfem_vec3 third(void *user, double u, double v) {
    int k = *(int *)user;
    double w[3], p[3], length;
    w[0] = (1 - u) * (1 - v) + (u * (1 - v) + v * (1 - u)) / 2 + u * v / 3;
    w[1] = u * (1 - v) / 2 + u * v / 3;
    w[2] = v * (1 - u) / 2 + u * v / 3;
    for (int i = 0; i < 3; i++) p[(i + k) % 3] = w[i];
    length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) / 10;
    return point(p[0] / length, p[1] / length, p[2] / length);
}

static int hemisphere_full(benchmark *b) {
    int half = b->n > 1 ? b->n / 2 : 1;
    material(b, 6.825e7, 0.3, 0.04);
    for (int k = 0; k < 3; k++)
        if (!shell_grid_add(&b->grid, half, half, b->triangles, 1e-4, third, &k)) return 0;
    return create(b) && pinch_dome(b, 0.0924);
}

/* ---- plates: a quarter of a square of side 1, thickness 1/100 ---- */

static dgfem_vec3 quarter(void *user, double u, double v) {
    (void)user;
    return point(u / 2, v / 2, 0);
}

static int plate(benchmark *b, int clamped, int spread) {
    const double factors[2][2] = {{0.011600839, 0.0040623527}, {0.0056120, 0.0012653191}};
    double stiffness;
    material(b, 1e7, 0.3, 0.01);
    stiffness = 1e7 * 1e-6 / (12 * (1 - 0.09));
    if (!build(b, b->n, b->n, quarter)) return 0;
    measure(b, point(0.5, 0.5, 0), 2, -1, factors[clamped][spread] / stiffness);
    for (int axis = 0; axis < 2; axis++) {
        dgfem_plane wall = plane_at(axis == 0, axis == 1, 0, 0), middle = wall;
        middle.offset = (dgfem_real)0.5;
        if (!symmetry(b, middle, 1)) return 0;
        if (clamped ? !clamp(b, wall, 1) : !fix(b, wall, 1, DGFEM_SHELL_XYZ)) return 0;
    }
    if (spread) return !failed(dgfem_shell_set_pressure(b->shell, NULL, 0, -1, 0, NULL));
    return push(b, point(0.5, 0.5, 0), point(0, 0, -0.25));
}

static int plate_ss_q(benchmark *b) { return plate(b, 0, 1); }
static int plate_ss_p(benchmark *b) { return plate(b, 0, 0); }
static int plate_cl_q(benchmark *b) { return plate(b, 1, 1); }
static int plate_cl_p(benchmark *b) { return plate(b, 1, 0); }

/* ---- strips ---- */

static dgfem_vec3 strip_map(void *user, double u, double v) {
    const benchmark *b = (const benchmark *)user;
    return point((b->load_steps > 10 ? 12 : 10) * u, v, 0);
}

static int build_strip(benchmark *b, double length, double force) {
    int count, *edges;
    dgfem_status status;
    material(b, 1.2e6, 0, 0.1);
    if (!build(b, b->n, 1, strip_map) || !clamp(b, plane_at(1, 0, 0, 0), length)) return 0;
    edges = on_plane(b->shell, plane_at(1, 0, 0, length), length, 1, &count);
    if (b->load_steps > 10) status = dgfem_shell_set_moment(b->shell, edges, count, (dgfem_real)force, 1, NULL);
    else status = dgfem_shell_set_line_load(b->shell, edges, count, point(0, 0, force), NULL);
    free(edges);
    return !failed(status);
}

static int strip(benchmark *b) {
    if (!build_strip(b, 10, 0.01)) return 0;
    measure(b, point(10, 0, 0), 2, 1, 0.01 * 1000 / 3 / 100);
    return 1;
}

static int endshear(benchmark *b) {
    b->desc.corotational = 1;
    b->load_steps = 4;
    if (!build_strip(b, 10, 4)) return 0;
    measure(b, point(10, 0, 0), 2, 1, 6.698);
    b->second_axis = 0, b->second_sign = -1, b->second_reference = 3.286;
    return 1;
}

/* Up to a full circle: the tip comes back to the clamp. */
static int rollup(benchmark *b) {
    b->desc.corotational = 1;
    b->load_steps = 16;
    if (!build_strip(b, 12, -50 * pi / 3)) return 0;
    measure(b, point(12, 0, 0), 0, -1, 12);
    b->second_axis = 2, b->second_sign = 1, b->second_reference = 0;
    return 1;
}

/* ---- main ---- */

static double component(dgfem_vec3 v, int axis) { return (double)(axis == 0 ? v.x : axis == 1 ? v.y : v.z); }

static double displacement(const benchmark *b, int axis) {
    return component(b->shell->position[b->probe], axis) - component(b->shell->rest[b->probe], axis);
}

static void report(const benchmark *b, double seconds, const dgfem_shell_info *info) {
    double u = b->sign * displacement(b, b->axis);
    printf("nodes %d\ndofs %d\n", b->shell->node_count, 3 * b->shell->node_count);
    printf("displacement %.9g\nreference %.9g\nnormalised %.6f\n", u, b->reference, u / b->reference);
    if (b->second_axis >= 0)
        printf("displacement_2 %.9g\nreference_2 %.9g\n", b->second_sign * displacement(b, b->second_axis),
               b->second_reference);
    printf("iterations %d\nmilliseconds %.3f\n", info->iterations, 1e3 * seconds);
}

int main(int argc, char **argv) {
    static int (*const tests[])(benchmark *) = {scordelis,  cylinder,   hemisphere, hemisphere_full,
                                                plate_ss_q, plate_ss_p, plate_cl_q, plate_cl_p,
                                                strip,      endshear,   rollup};
    program p = program_begin(argc, argv,
                              "shell_benchmark --test scordelis|cylinder|hemisphere|hemisphere_full|plate_ss_q|"
                              "plate_ss_p|plate_cl_q|plate_cl_p|strip|endshear|rollup [--element q8|t6] [--n N] "
                              "[--eta E]");
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    dgfem_shell_info info;
    benchmark b;
    double eta, start;
    int test;
    memset(&b, 0, sizeof b);
    b.desc = dgfem_default_shell_desc();
    b.desc.hooks = program_hooks();
    b.desc.corotational = 0;
    b.load_steps = 1;
    b.second_axis = -1;
    test = program_choice(&p, "--test",
                          "scordelis|cylinder|hemisphere|hemisphere_full|plate_ss_q|plate_ss_p|plate_cl_q|plate_cl_p|"
                          "strip|endshear|rollup",
                          0);
    b.triangles = program_choice(&p, "--element", "q8|t6", 0);
    b.n = program_int(&p, "--n", 16, 1, 512);
    eta = program_real(&p, "--eta", b.triangles ? (double)b.desc.eta_triangle : (double)b.desc.eta_quad);
    program_end(&p);
    b.desc.eta_quad = b.desc.eta_triangle = (dgfem_real)eta;
    start = program_seconds();
    if (!tests[test](&b)) return 1;
    how.load_steps = b.load_steps;
    if (failed(dgfem_shell_solve_static(b.shell, &how, &info))) return 1;
    report(&b, program_seconds() - start, &info);
    dgfem_shell_destroy(b.shell);
    shell_grid_free(&b.grid);
    return 0;
}
