/* A solid's state without its forms and solver, filled in by hand: what embedding, skin and contact look at. */
#ifndef CHECK_BODY_H
#define CHECK_BODY_H

#include "check.h"

/* Takes over the mesh; all elements have one material (1e6 Pa, 0.3, 1000 kg/m^3). */
static inline dgfem_body *check_body_create(dgfem_mesh *mesh, const int *degrees, int degree,
                                            const dgfem_hooks *hooks) {
    dgfem_body *body = (dgfem_body *)calloc(1, sizeof *body);
    size_t count = (size_t)mesh->element_count;
    int e;
    assert_non_null(body);
    body->mesh = mesh;
    if (hooks) body->hooks = *hooks;
    body->degree = (int *)calloc(count, sizeof *body->degree);
    body->material = (dgfem_material *)calloc(count, sizeof *body->material);
    body->origin = (dgfem_vec3 *)calloc(count, sizeof *body->origin);
    body->scale = (dgfem_real *)calloc(count, sizeof *body->scale);
    body->basis_start = (int *)calloc(count + 1, sizeof *body->basis_start);
    for (e = 0; e < mesh->element_count; e++) {
        body->degree[e] = degrees ? degrees[e] : degree;
        body->material[e].young = (dgfem_real)1e6;
        body->material[e].poisson = (dgfem_real)0.3;
        body->material[e].density = 1000;
        body->origin[e] = mesh->elements[e].centre;
        body->scale[e] = mesh->elements[e].radius;
        body->basis_start[e + 1] = body->basis_start[e] + dgfem_monomial_count(body->degree[e]);
    }
    body->basis_count = body->basis_start[mesh->element_count];
    body->displacement = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *body->displacement);
    body->velocity = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *body->velocity);
    return body;
}

static inline void check_body_destroy(dgfem_body *body) {
    dgfem_mesh_destroy(body->mesh);
    free(body->degree);
    free(body->material);
    free(body->origin);
    free(body->scale);
    free(body->basis_start);
    free(body->displacement);
    free(body->velocity);
    free(body->shapes);
    free(body);
}

/* value(x) = offset + linear x */
typedef struct check_affine {
    dgfem_mat3 linear;
    dgfem_vec3 offset;
} check_affine;

static inline check_affine check_random_affine(check_random *random) {
    check_affine affine;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) affine.linear.m[i][j] = (dgfem_real)check_random_real(random, -1, 1);
    affine.offset = check_random_vec3(random, -1, 1);
    return affine;
}

static inline dgfem_vec3 check_affine_at(const check_affine *affine, dgfem_vec3 x) {
    const dgfem_mat3 *a = &affine->linear;
    dgfem_vec3 y;
    y.x = affine->offset.x + a->m[0][0] * x.x + a->m[0][1] * x.y + a->m[0][2] * x.z;
    y.y = affine->offset.y + a->m[1][0] * x.x + a->m[1][1] * x.y + a->m[1][2] * x.z;
    y.z = affine->offset.z + a->m[2][0] * x.x + a->m[2][1] * x.y + a->m[2][2] * x.z;
    return y;
}

/* The coefficients of an affine field: its value at each element's origin and its slopes times the element's scale. */
static inline void check_set_affine(const dgfem_body *body, dgfem_vec3 *coefficients, const check_affine *affine) {
    const dgfem_mat3 *a = &affine->linear;
    int e, axis;
    memset(coefficients, 0, (size_t)body->basis_count * sizeof *coefficients);
    for (e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 *u = coefficients + body->basis_start[e];
        u[0] = check_affine_at(affine, body->origin[e]);
        for (axis = 0; axis < 3; axis++) {
            u[1 + axis].x = a->m[0][axis] * body->scale[e];
            u[1 + axis].y = a->m[1][axis] * body->scale[e];
            u[1 + axis].z = a->m[2][axis] * body->scale[e];
        }
    }
}

#endif
