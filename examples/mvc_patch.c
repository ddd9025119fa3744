/* The patch test: all nodes on the boundary of a cube of polyhedra are moved linearly, and all others must follow.
   Prints one line of names and one of numbers: elements and nodes; the largest error of a node relative to the
   largest displacement; the least (but for the six zeros of rigid motions) and the largest eigenvalue of the
   elements' stiffness matrices, for 1 Pa and a cube of 1 m, in N/m.

   The corrected rules have errors of round-off on all meshes; the one as published only where elements are alike. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"
#include "convex_mesh.h"
#include "program.h"

enum { CUBE, HEX, VORONOI, PLANES };

static dgfem_status make_mesh(int kind, int n, uint64_t seed, dgfem_mesh **mesh) {
    if (kind == HEX) return convex_mesh_hexahedra(n, seed, mesh);
    if (kind == VORONOI) return convex_mesh_voronoi(n, 1, seed, mesh);
    if (kind == PLANES) return convex_mesh_random_planes(3 * n, seed, mesh);
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    grid.cells[0] = grid.cells[1] = grid.cells[2] = n;
    return dgfem_mesh_create_grid(&grid, mesh);
}

/* x -> linear x + offset, a displacement. */
static const dgfem_real linear[3][3] = {{DGFEM_R(0.03), DGFEM_R(-0.05), DGFEM_R(0.02)},
                                        {DGFEM_R(0.01), DGFEM_R(-0.02), DGFEM_R(0.07)},
                                        {DGFEM_R(-0.04), DGFEM_R(0.06), DGFEM_R(0.05)}};

static dgfem_vec3 displacement(dgfem_vec3 x) {
    return convex_mesh_vec3((double)(linear[0][0] * x.x + linear[0][1] * x.y + linear[0][2] * x.z),
                            (double)(linear[1][0] * x.x + linear[1][1] * x.y + linear[1][2] * x.z),
                            (double)(linear[2][0] * x.x + linear[2][1] * x.y + linear[2][2] * x.z));
}

static double length(dgfem_vec3 v) { return sqrt((double)(v.x * v.x + v.y * v.y + v.z * v.z)); }

/* Largest error relative to the largest displacement; NaN on failure. */
static double patch_test(dgfem_mvc *body) {
    int *nodes = (int *)malloc((size_t)body->node_count * sizeof(int)), id;
    double worst = 0, largest = 0;
    dgfem_mat3 matrix;
    if (!nodes) return NAN;
    memcpy(matrix.m, linear, sizeof linear);
    int count = dgfem_mvc_boundary_nodes(body, nodes, body->node_count);
    dgfem_status status = dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, convex_mesh_vec3(0, 0, 0), &id);
    if (!status) status = dgfem_mvc_move_fixture(body, id, matrix, convex_mesh_vec3(0, 0, 0));
    if (!status) status = dgfem_mvc_solve_static(body, NULL, NULL);
    free(nodes);
    if (status) return NAN; /* the library has said why */
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 u = displacement(body->rest[i]), x = body->position[i], r = body->rest[i];
        dgfem_vec3 error =
            convex_mesh_vec3((double)(x.x - r.x - u.x), (double)(x.y - r.y - u.y), (double)(x.z - r.z - u.z));
        worst = fmax(worst, length(error));
        largest = fmax(largest, length(u));
    }
    return worst / largest;
}

/* Eigenvalues, ascending, of a symmetric matrix of size n, row-major, by Jacobi's method; the matrix is destroyed. */
static void eigenvalues(double *a, int n, double *values) {
    for (int sweep = 0; sweep < 60; sweep++) {
        double off = 0, all = 0;
        for (int i = 0; i < n * n; i++) all += a[i] * a[i], off += i / n == i % n ? 0 : a[i] * a[i];
        if (!(off > 1e-30 * all)) break;
        for (int p = 0; p < n - 1; p++)
            for (int q = p + 1; q < n; q++) {
                double apq = a[p * n + q];
                if (apq * apq <= 1e-40 * all) continue;
                double half = (a[q * n + q] - a[p * n + p]) / (2 * apq);
                double t = (half < 0 ? -1 : 1) / (fabs(half) + sqrt(half * half + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < n; k++) {
                    double x = a[k * n + p], y = a[k * n + q];
                    a[k * n + p] = c * x - s * y, a[k * n + q] = s * x + c * y;
                }
                for (int k = 0; k < n; k++) {
                    double x = a[p * n + k], y = a[q * n + k];
                    a[p * n + k] = c * x - s * y, a[q * n + k] = s * x + c * y;
                }
            }
    }
    for (int i = 0; i < n; i++) values[i] = a[i * n + i];
    for (int i = 1; i < n; i++)
        for (int j = i; j > 0 && values[j] < values[j - 1]; j--) {
            double swap = values[j];
            values[j] = values[j - 1], values[j - 1] = swap;
        }
}

/* Extremes over all elements. */
static int element_eigenvalues(const dgfem_mvc *body, double *least, double *largest) {
    *least = INFINITY, *largest = 0;
    for (int e = 0; e < body->element_count; e++) {
        int n = 3 * dgfem_mvc_element_nodes(body, e, NULL, 0);
        size_t count = (size_t)n * (size_t)n;
        dgfem_real *stiffness = (dgfem_real *)malloc(count * sizeof *stiffness);
        double *a = (double *)malloc((count + (size_t)n) * sizeof *a);
        int ok = stiffness && a && !dgfem_mvc_element_stiffness(body, e, stiffness);
        for (size_t i = 0; ok && i < count; i++) a[i] = (double)stiffness[i];
        if (ok) eigenvalues(a, n, a + count);
        if (ok) *least = fmin(*least, a[count + 6]), *largest = fmax(*largest, a[count + (size_t)n - 1]);
        free(stiffness), free(a);
        if (!ok) return 0;
    }
    return 1;
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "mvc_patch [--mesh cube|hex|voronoi|planes] [--seed S] [--n N] "
                              "[--quadrature tet4|paper|paper_raw]");
    int kind = program_choice(&p, "--mesh", "cube|hex|voronoi|planes", VORONOI);
    int seed = program_int(&p, "--seed", 1, 0, INT_MAX), n = program_int(&p, "--n", 3, 1, 12);
    int quadrature = program_choice(&p, "--quadrature", "tet4|paper|paper_raw", 0);
    program_end(&p);
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_mesh *mesh;
    dgfem_mvc *body;
    double least, largest;
    dgfem_status status = make_mesh(kind, n, (uint64_t)seed, &mesh);
    if (status) return fprintf(stderr, "mesh: %s\n", dgfem_status_text(status)), 1;
    desc.mesh = mesh;
    desc.quadrature = (dgfem_mvc_quadrature)quadrature;
    desc.material.young = 1;
    desc.gravity = convex_mesh_vec3(0, 0, 0);
    desc.warp = 0;
    desc.hooks = program_hooks();
    status = dgfem_mvc_create(&desc, &body);
    dgfem_mesh_destroy(mesh);
    if (status) return 1;
    double error = patch_test(body);
    if (!isfinite(error) || !element_eigenvalues(body, &least, &largest)) return 1;
    printf("elements nodes max_error min_eigen max_eigen\n");
    printf("%d %d %.3e %.6g %.6g\n", body->element_count, body->node_count, error, least, largest);
    dgfem_mvc_destroy(body);
    return 0;
}
