/* The demo's pieces one by one: slicing, splitting, creating a body, and one step by phase. The shape is build/bunny.obj
   where it exists (make demo fetches it), else a torus. Best of several runs; milliseconds. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "program.h"

static const double peer_slice[] = {35, 243}; /* manifold, serial, at 4 and 11 cells, as published in the project's notes */

static int make_torus(formats_surface *surface) {
    enum { AROUND = 80, TUBE = 24 };
    const double turn = 6.28318530717958648;
    surface->vertex_count = AROUND * TUBE;
    surface->triangle_count = 2 * AROUND * TUBE;
    surface->vertices = (double *)malloc((size_t)surface->vertex_count * 3 * sizeof(double));
    surface->triangles = (int *)malloc((size_t)surface->triangle_count * 3 * sizeof(int));
    if (!surface->vertices || !surface->triangles) return 0;
    for (int i = 0; i < AROUND; i++)
        for (int j = 0; j < TUBE; j++) {
            double a = turn * i / AROUND, b = turn * j / TUBE, r = 1 + 0.4 * cos(b);
            double *x = surface->vertices + 3 * (i * TUBE + j);
            int *t = surface->triangles + 6 * (i * TUBE + j);
            int right = (i + 1) % AROUND, up = (j + 1) % TUBE;
            x[0] = r * cos(a), x[1] = r * sin(a), x[2] = 0.4 * sin(b);
            t[0] = i * TUBE + j, t[1] = right * TUBE + j, t[2] = right * TUBE + up;
            t[3] = i * TUBE + j, t[4] = right * TUBE + up, t[5] = i * TUBE + up;
        }
    return 1;
}

static dgfem_mesh *slice(const formats_surface *surface, int cells, double sliver) {
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    dgfem_mesh *mesh = NULL;
    desc.vertices = dgfem_points_in_double(surface->vertices, surface->vertex_count);
    desc.triangles = surface->triangles;
    desc.triangle_count = surface->triangle_count;
    desc.cells = cells;
    desc.sliver = (dgfem_real)sliver;
    desc.hooks = program_hooks();
    return dgfem_mesh_create_slices(&desc, &mesh) ? NULL : mesh;
}

static void bench_slicing(const formats_surface *surface) {
    static const int cells[] = {4, 11, 20};
    for (int k = 0; k < 3; k++) {
        double best = 1e300;
        int elements = 0;
        for (int run = 0; run < 20; run++) {
            double start = program_seconds();
            dgfem_mesh *mesh = slice(surface, cells[k], 0);
            best = fmin(best, program_seconds() - start);
            if (!mesh) return;
            elements = mesh->element_count;
            dgfem_mesh_destroy(mesh);
        }
        printf("slice %2d cells: %5d elements %8.2f ms", cells[k], elements, 1e3 * best);
        if (k < 2) printf("   (published peer on a bunny: %.0f)", peer_slice[k]);
        printf("\n");
    }
}

static void bench_split(const formats_surface *surface) {
    double best = 1e300;
    int split = 0;
    for (int run = 0; run < 20; run++) {
        dgfem_mesh *mesh = slice(surface, 11, 1e-3);
        if (!mesh) return;
        dgfem_vec3 c = mesh->elements[mesh->element_count / 2].centre;
        dgfem_plane plane = {{DGFEM_R(0.5), DGFEM_R(0.3), DGFEM_R(0.8)}, 0};
        plane.offset = plane.normal.x * c.x + plane.normal.y * c.y + plane.normal.z * c.z;
        double start = program_seconds();
        dgfem_mesh_split_plane(mesh, plane, DGFEM_R(1e-3), &split);
        best = fmin(best, program_seconds() - start);
        dgfem_mesh_destroy(mesh);
    }
    printf("split by one oblique plane: %d elements %8.2f ms\n", split, 1e3 * best);
}

static void bench_body(const formats_surface *surface, dgfem_solver solver, const char *name) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_step_info best, info;
    dgfem_body *body;
    double total = 1e300;
    desc.mesh = slice(surface, 11, 1e-3);
    desc.material.young = DGFEM_R(1.5e5);
    desc.solver = solver;
    desc.hooks = program_hooks();
    if (!desc.mesh) return;
    double start = program_seconds();
    if (dgfem_body_create(&desc, &body)) {
        dgfem_mesh_destroy(desc.mesh);
        return;
    }
    double create = program_seconds() - start;
    memset(&best, 0, sizeof best);
    for (int run = 0; run < 20; run++) {
        start = program_seconds();
        if (dgfem_body_step(body, DGFEM_R(1.0) / 60, &info)) break;
        double seconds = program_seconds() - start;
        if (seconds < total) total = seconds, best = info;
    }
    printf("body, %-8s  %5d unknowns: create %.2f ms, step %.2f ms (assemble %.2f, factor %.2f, solve %.2f, "
           "%d iterations)\n",
           name, 3 * body->basis_count, 1e3 * create, 1e3 * total, 1e3 * best.seconds_assemble,
           1e3 * best.seconds_factor, 1e3 * best.seconds_solve, best.iterations);
    dgfem_body_destroy(body);
}

int main(void) {
    formats_surface surface;
    formats_error error;
    memset(&surface, 0, sizeof surface);
    if (!formats_read_surface("build/bunny.obj", &surface, &error)) {
        printf("%s: a torus stands in\n", error.text);
        if (!make_torus(&surface)) return 1;
    }
    bench_slicing(&surface);
    bench_split(&surface);
    bench_body(&surface, DGFEM_SOLVER_CHOLESKY, "Cholesky");
    bench_body(&surface, DGFEM_SOLVER_PCG, "PCG");
    formats_free_surface(&surface);
    return 0;
}
