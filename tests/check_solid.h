/* Solids for tests: boxes of soft material, their faces, and what to ask of them. */
#ifndef CHECK_SOLID_H
#define CHECK_SOLID_H

#include "check.h"

enum { MAX_FACES = 4096 };

/* 1 Pa, Poisson's ratio 0.3, 1 kg/m^3, no gravity. */
static inline dgfem_body_desc soft_desc(void) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    desc.material.young = 1;
    desc.material.density = 1;
    desc.gravity = vec3(0, 0, 0);
    return desc;
}

/* A box of nx * ny * nz cells with a corner at `lower`; the body owns its mesh. */
static inline dgfem_body *make_box_at(const dgfem_body_desc *base, int nx, int ny, int nz, dgfem_vec3 lower,
                                      dgfem_vec3 size) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc desc = *base;
    dgfem_body *body = NULL;
    grid.cells[0] = nx, grid.cells[1] = ny, grid.cells[2] = nz;
    grid.lower = lower;
    grid.upper =
        vec3((double)lower.x + (double)size.x, (double)lower.y + (double)size.y, (double)lower.z + (double)size.z);
    grid.hooks = base->hooks;
    check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    return body;
}

static inline dgfem_body *make_box(const dgfem_body_desc *base, int nx, int ny, int nz, double lx, double ly,
                                   double lz) {
    return make_box_at(base, nx, ny, nz, vec3(0, 0, 0), vec3(lx, ly, lz));
}

static inline dgfem_plane plane_x(double offset) {
    dgfem_plane plane;
    plane.normal = vec3(1, 0, 0);
    plane.offset = (dgfem_real)offset;
    return plane;
}

/* faces[MAX_FACES]; the result is their number, at least 1. */
static inline int faces_at_x(const dgfem_body *body, double x, int *faces) {
    int count = dgfem_mesh_faces_on_plane(body->mesh, plane_x(x), (dgfem_real)1e-4, faces, MAX_FACES);
    assert_in_range(count, 1, MAX_FACES);
    return count;
}

static inline int all_boundary_faces(const dgfem_body *body, int *faces) {
    int count = 0;
    for (int f = 0; f < body->mesh->face_count; f++)
        if (body->mesh->faces[f].element[1] == DGFEM_NONE) {
            assert_in_range(count, 0, MAX_FACES - 1);
            faces[count++] = f;
        }
    return count;
}

/* Boundary faces by the side of the box that the grid tags them with (-x +x -y +y -z +z). */
static inline int faces_of_side(const dgfem_body *body, int side, int *faces) {
    int count = 0;
    for (int f = 0; f < body->mesh->face_count && count < MAX_FACES; f++)
        if (body->mesh->faces[f].element[1] == DGFEM_NONE && body->mesh->faces[f].tag == side) faces[count++] = f;
    assert_in_range(count, 1, MAX_FACES);
    return count;
}

static inline void clamp_at_x(dgfem_body *body, double x) {
    int faces[MAX_FACES], count = faces_at_x(body, x, faces);
    check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), DGFEM_OK);
}

static inline void solve(dgfem_body *body) {
    dgfem_static_desc desc = dgfem_default_static_desc();
    check_status(dgfem_body_solve_static(body, &desc, NULL), DGFEM_OK);
}

/* A row-major 3x3 matrix. */
static inline dgfem_mat3 matrix(const double *m) {
    dgfem_mat3 a;
    for (int i = 0; i < 9; i++) a.m[i / 3][i % 3] = (dgfem_real)m[i];
    return a;
}

/* Rotation about an axis, minus the identity: the linear part of a turn's displacement. */
static inline dgfem_mat3 rotation_minus_identity(double x, double y, double z, double angle) {
    double n = sqrt(x * x + y * y + z * z), c = cos(angle), s = sin(angle);
    x /= n, y /= n, z /= n;
    double m[9] = {(c - 1) * (1 - x * x),   (1 - c) * x * y - s * z, (1 - c) * x * z + s * y,
                   (1 - c) * x * y + s * z, (c - 1) * (1 - y * y),   (1 - c) * y * z - s * x,
                   (1 - c) * x * z - s * y, (1 - c) * y * z + s * x, (c - 1) * (1 - z * z)};
    return matrix(m);
}

#endif
