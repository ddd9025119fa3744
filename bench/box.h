/* A box of hexahedra, held at x = 0 and let go at rest: it swings down under gravity. E = 1e5 Pa, nu = 0.3,
   1000 kg/m^3, interior penalty, no damping, no contact. */
#ifndef BOX_H
#define BOX_H

#include "bench.h"

typedef struct box {
    double size[3]; /* m */
    int cells[3];
    int degree;
    dgfem_solver solver;
    dgfem_hooks mesh_hooks, hooks;
} box;

static inline box box_of(double x, double y, double z, const int *cells, dgfem_solver solver) {
    box b;
    memset(&b, 0, sizeof b);
    b.size[0] = x, b.size[1] = y, b.size[2] = z;
    memcpy(b.cells, cells, sizeof b.cells);
    b.degree = 1;
    b.solver = solver;
    b.mesh_hooks = b.hooks = bench_hooks(NULL);
    return b;
}

static inline dgfem_plane box_plane(double x) {
    dgfem_plane plane;
    memset(&plane, 0, sizeof plane);
    plane.normal.x = 1;
    plane.offset = (dgfem_real)x;
    return plane;
}

/* Boundary faces at this x, to be freed. */
static inline int *box_faces(const dgfem_mesh *mesh, double x, int *count) {
    const dgfem_real tolerance = DGFEM_R(1e-5);
    *count = dgfem_mesh_faces_on_plane(mesh, box_plane(x), tolerance, NULL, 0);
    int *faces = (int *)room((size_t)*count, sizeof *faces);
    (void)dgfem_mesh_faces_on_plane(mesh, box_plane(x), tolerance, faces, *count);
    return faces;
}

static inline dgfem_mesh *box_mesh(const box *b) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mesh *mesh = NULL;
    grid.upper.x = (dgfem_real)b->size[0], grid.upper.y = (dgfem_real)b->size[1], grid.upper.z = (dgfem_real)b->size[2];
    memcpy(grid.cells, b->cells, sizeof grid.cells);
    grid.hooks = b->mesh_hooks;
    expect(dgfem_mesh_create_grid(&grid, &mesh) == DGFEM_OK, "dgfem_mesh_create_grid");
    return mesh;
}

/* The free one: nothing holds it yet. */
static inline dgfem_body *box_free_body(const box *b) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_body *body = NULL;
    desc.mesh = box_mesh(b);
    desc.material.young = DGFEM_R(1e5);
    desc.material.poisson = DGFEM_R(0.3);
    desc.degree = b->degree;
    desc.solver = b->solver;
    desc.hooks = b->hooks;
    expect(dgfem_body_create(&desc, &body) == DGFEM_OK, "dgfem_body_create");
    return body;
}

static inline dgfem_body *box_body(const box *b) {
    dgfem_body *body = box_free_body(b);
    dgfem_vec3 none;
    int count, *faces = box_faces(body->mesh, 0, &count);
    memset(&none, 0, sizeof none);
    expect(dgfem_body_fix_faces(body, faces, count, none, NULL) == DGFEM_OK, "dgfem_body_fix_faces");
    free(faces);
    return body;
}

/* Mean displacement of the boundary faces at this x. */
static inline void box_tip(const dgfem_body *body, double x, double tip[3]) {
    int count, *faces = box_faces(body->mesh, x, &count);
    double area = 0;
    tip[0] = tip[1] = tip[2] = 0;
    for (int i = 0; i < count; i++) {
        double a = (double)body->mesh->faces[faces[i]].area;
        dgfem_vec3 u = dgfem_body_face_displacement(body, faces[i]);
        tip[0] += a * (double)u.x, tip[1] += a * (double)u.y, tip[2] += a * (double)u.z;
        area += a;
    }
    for (int k = 0; k < 3; k++) tip[k] /= area;
    free(faces);
}

/* ---- the hanging bar: 1 m long, a quarter of that wide and high ---- */

static inline box bar_of(const int *cells, dgfem_solver solver) { return box_of(1, 0.25, 0.25, cells, solver); }

#endif
