/* What a cut costs. Time against the number k of elements that a blade splits, on a bunny of 20 cells, beside making the
   body anew: geometry and integrals (the body has PCG for a solver), and with the symbolic analysis for Cholesky's. Then,
   on the demo's bunny of 11 cells, the step that cuts beside an ordinary one. The shape is build/bunny.obj where it
   exists, else one made here. Best of several runs; milliseconds. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "model.h"
#include "program.h"

enum { RUNS = 5 };

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

/* Takes the mesh over. */
static dgfem_body *make_body(dgfem_mesh *mesh, dgfem_solver solver) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_body *body = NULL;
    if (!mesh) return NULL;
    desc.mesh = mesh;
    desc.material.young = DGFEM_R(4e5);
    desc.solver = solver;
    desc.hooks = program_hooks();
    if (dgfem_body_create(&desc, &body)) {
        dgfem_mesh_destroy(mesh);
        return NULL;
    }
    return body;
}

static dgfem_body *copy_body(const dgfem_mesh *mesh, dgfem_solver solver) {
    dgfem_mesh *copy = NULL;
    return dgfem_mesh_copy(mesh, &copy) ? NULL : make_body(copy, solver);
}

static dgfem_skin *make_skin(const dgfem_body *body, const formats_surface *surface) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_skin *skin = NULL;
    desc.vertices = dgfem_points_in_double(surface->vertices, surface->vertex_count);
    desc.triangles = surface->triangles;
    desc.triangle_count = surface->triangle_count;
    desc.hooks = program_hooks();
    return dgfem_skin_create(body, &desc, &skin) ? NULL : skin;
}

/* A square across the middle of the bunny, tilted so that it meets elements obliquely, of half the edge `reach`. */
static void make_blade(double reach, dgfem_vec3 corners[4]) {
    static const double u[3] = {0.96, 0, 0.28}, v[3] = {-0.056, 0.98, 0.192};
    for (int k = 0; k < 4; k++) {
        double a = k == 1 || k == 2 ? reach : -reach, b = k >= 2 ? reach : -reach;
        corners[k].x = (dgfem_real)(0.0031 + a * u[0] + b * v[0]);
        corners[k].y = (dgfem_real)(0.0017 + a * u[1] + b * v[1]);
        corners[k].z = (dgfem_real)(0.4013 + a * u[2] + b * v[2]);
    }
}

typedef struct times {
    double cut, anew; /* the cut, and a body made anew from the mesh that the cut left */
    int k, faces, elements;
} times;

static int measure(const dgfem_mesh *mesh, dgfem_solver solver, double reach, times *t) {
    dgfem_mat3 turn = {{{0, DGFEM_R(-1e-3), 0}, {DGFEM_R(1e-3), 0, 0}, {0, DGFEM_R(2e-3), 0}}};
    dgfem_vec3 corners[4], shift = {0, 0, 0};
    make_blade(reach, corners);
    t->cut = t->anew = 1e300;
    for (int run = 0; run < RUNS; run++) {
        dgfem_cut_info info;
        dgfem_body *body = copy_body(mesh, solver), *other = NULL;
        if (!body || dgfem_body_set_affine(body, turn, shift)) return dgfem_body_destroy(body), 0;
        double start = program_seconds();
        dgfem_status status = dgfem_body_cut_polygon(body, dgfem_points_in_vec3(corners, 4), NULL, &info);
        t->cut = fmin(t->cut, program_seconds() - start);
        start = program_seconds();
        if (!status) other = copy_body(body->mesh, solver);
        t->anew = fmin(t->anew, program_seconds() - start);
        t->k = info.elements_split, t->faces = info.faces_cut, t->elements = body->mesh->element_count;
        int ok = other != NULL;
        dgfem_body_destroy(other);
        dgfem_body_destroy(body);
        if (!ok) return 0;
    }
    return 1;
}

static void bench_size(const formats_surface *surface) {
    static const double reach[] = {0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5, 2};
    dgfem_mesh *mesh = slice(surface, 20, 0);
    if (!mesh) return;
    printf("bunny of 20 cells, %d elements\n", mesh->element_count);
    printf("                              geometry and integrals     with symbolic analysis\n");
    printf("    k  faces cut  elements       cut    body anew          cut    body anew\n");
    for (size_t i = 0; i < sizeof reach / sizeof *reach; i++) {
        times t, c;
        if (!measure(mesh, DGFEM_SOLVER_PCG, reach[i], &t) || !measure(mesh, DGFEM_SOLVER_CHOLESKY, reach[i], &c))
            break;
        printf("%5d      %5d     %5d  %8.2f     %8.2f     %8.2f     %8.2f\n", t.k, t.faces, t.elements, 1e3 * t.cut,
               1e3 * t.anew, 1e3 * c.cut, 1e3 * c.anew);
    }
    dgfem_mesh_destroy(mesh);
}

/* The demo's bunny in motion: some steps, a cut by an oblique plane with the step after it, and again. */
static void bench_step(const formats_surface *surface, dgfem_solver solver, const char *name, int with_skin) {
    const dgfem_real dt = DGFEM_R(1.0) / 60;
    double ordinary = 1e300, cutting = 1e300, cut = 1e300;
    int split = 0, elements = 0;
    for (int run = 0; run < RUNS; run++) {
        dgfem_body *body = make_body(slice(surface, 11, 1e-3), solver);
        dgfem_skin *skin = body && with_skin ? make_skin(body, surface) : NULL;
        dgfem_cut_desc desc = dgfem_default_cut_desc();
        dgfem_plane plane = {{DGFEM_R(0.5), DGFEM_R(0.3), DGFEM_R(0.8)}, DGFEM_R(0.35)};
        dgfem_cut_info info;
        dgfem_status status = body && (skin || !with_skin) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
        double start = 0;
        desc.skins = &skin, desc.skin_count = with_skin;
        for (int i = 0; !status && i < 6; i++) {
            start = program_seconds();
            status = dgfem_body_step(body, dt, NULL);
            if (!status && skin) status = dgfem_skin_update(skin, body);
            ordinary = fmin(ordinary, program_seconds() - start);
        }
        start = program_seconds();
        if (!status) status = dgfem_body_cut_plane(body, plane, &desc, &info);
        cut = fmin(cut, program_seconds() - start);
        if (!status) status = dgfem_body_step(body, dt, NULL);
        if (!status && skin) status = dgfem_skin_update(skin, body);
        cutting = fmin(cutting, program_seconds() - start);
        if (!status) split = info.elements_split, elements = body->mesh->element_count;
        dgfem_skin_destroy(skin);
        dgfem_body_destroy(body);
        if (status) return;
    }
    printf("bunny of 11 cells, %s%s: ordinary step %.2f, cut of %d elements %.2f, step that cuts %.2f: %.2f ordinary "
           "ones; %d elements after it\n",
           name, with_skin ? ", with skin" : "", 1e3 * ordinary, split, 1e3 * cut, 1e3 * cutting, cutting / ordinary,
           elements);
}

int main(void) {
    formats_surface surface;
    FILE *file = fopen("build/bunny.obj", "r");
    if (file) fclose(file);
    if (!model_read(file ? "build/bunny.obj" : NULL, &surface)) return 1;
    bench_size(&surface);
    for (int with_skin = 0; with_skin < 2; with_skin++) {
        bench_step(&surface, DGFEM_SOLVER_CHOLESKY, "Cholesky", with_skin);
        bench_step(&surface, DGFEM_SOLVER_AUTO, "automatic", with_skin);
    }
    formats_free_surface(&surface);
    return 0;
}
