#pragma once
#include "solve.c"
/* Asking a solid: fields at a point, energies, momenta, volume, internal force; setting affine fields. */

/* ---- queries ---- */

DGFEM_API dgfem_vec3 dgfem_body_displacement(const dgfem_body *body, int element, dgfem_vec3 rest) {
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    return dgfemi_evaluate(body, body->displacement, element, rest);
}

DGFEM_API dgfem_vec3 dgfem_body_velocity(const dgfem_body *body, int element, dgfem_vec3 rest) {
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    return dgfemi_evaluate(body, body->velocity, element, rest);
}

DGFEM_API dgfem_mat3 dgfem_body_gradient(const dgfem_body *body, int element, dgfem_vec3 rest) {
    dgfem_vec3 gradients[DGFEM_MAX_BASIS];
    dgfem_mat3 f = dgfemi_identity();
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    int start = body->basis_start[element];
    dgfemi_basis_gradients(body->degree[element], body->origin[element], body->scale[element], rest, gradients);
    for (int i = 1; i < body->basis_start[element + 1] - start; i++)
        dgfemi_add_outer(&f, 1, body->displacement[start + i], gradients[i]);
    return f;
}

/* The current rotation of one element: that of its displacement now, not of the last step's start. */
static dgfem_mat3 dgfemi_rotation_now(const dgfem_body *body, int element) {
    if (!body->desc.warp) return dgfemi_identity();
    return dgfem_rotation_of(dgfemi_mean_gradient(body, element), body->rotation[element]);
}

DGFEM_API dgfem_mat3 dgfem_body_stress(const dgfem_body *body, int element, dgfem_vec3 rest) {
    dgfem_mat3 f = dgfem_body_gradient(body, element, rest), r = dgfemi_rotation_now(body, element);
    dgfem_mat3 rt = dgfemi_transposed(&r), stretch = dgfemi_multiply3(&rt, &f), stress;
    dgfem_real lambda = dgfemi_lambda(&body->material[element]), mu = dgfemi_mu(&body->material[element]);
    dgfem_real volumetric = lambda * (dgfemi_trace(&stretch) - 3);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            stress.m[i][j] = mu * (stretch.m[i][j] + stretch.m[j][i]) + (i == j ? volumetric - 2 * mu : 0);
    stress = dgfemi_multiply3(&r, &stress);
    return dgfemi_multiply3(&stress, &rt);
}

DGFEM_API dgfem_mat3 dgfem_body_rotation(const dgfem_body *body, int element) {
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    return dgfemi_rotation_now(body, element);
}

DGFEM_API dgfem_vec3 dgfem_body_face_displacement(const dgfem_body *body, int face) {
    DGFEM_ASSERT(body && face >= 0 && face < body->mesh->face_count);
    const dgfem_face *f = &body->mesh->faces[face];
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int sides = f->element[1] == DGFEM_NONE ? 1 : 2;
    for (int s = 0; s < sides; s++) {
        int e = f->element[s], start = body->basis_start[e];
        dgfem_real moments[DGFEM_MAX_MOMENTS];
        dgfemi_mesh_face_moments(body->mesh, face, body->degree[e], body->origin[e], body->scale[e], moments);
        for (int i = 0; i < body->basis_start[e + 1] - start; i++)
            sum = dgfemi_add_scaled(sum, moments[i] / ((dgfem_real)sides * moments[0]), body->displacement[start + i]);
    }
    return sum;
}

/* ---- affine fields ---- */

static void dgfemi_set_affine(const dgfem_body *body, const dgfem_mat3 *linear, dgfem_vec3 translation,
                              dgfem_vec3 *coefficients) {
    for (int e = 0; e < body->mesh->element_count; e++)
        dgfemi_affine_element(body, e, linear, translation, coefficients + body->basis_start[e]);
}

DGFEM_API dgfem_status dgfem_body_set_affine(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_affine(body, &linear, translation);
    if (status) return status;
    dgfemi_set_affine(body, &linear, translation, body->displacement);
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    dgfemi_commit_rotation(body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_set_affine_velocity(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_affine(body, &linear, translation);
    if (!status) dgfemi_set_affine(body, &linear, translation, body->velocity);
    return status;
}

/* ---- conserved quantities ---- */

/* int_element N_i position for one element: rest position is origin + scale * (linear monomials). */
static dgfem_vec3 dgfemi_position_coefficient(const dgfem_body *body, int element, int i) {
    dgfem_vec3 x = body->displacement[body->basis_start[element] + i];
    if (i == 0) x = dgfemi_add(x, body->origin[element]);
    if (i == 1) x.x += body->scale[element];
    if (i == 2) x.y += body->scale[element];
    if (i == 3) x.z += body->scale[element];
    return x;
}

DGFEM_API dgfem_real dgfem_body_mass(const dgfem_body *body) {
    dgfem_real mass = 0;
    for (int e = 0; e < body->mesh->element_count; e++)
        mass += body->material[e].density * body->mesh->elements[e].volume;
    return mass;
}

DGFEM_API dgfem_status dgfem_body_momentum(const dgfem_body *body, dgfem_vec3 *linear, dgfem_vec3 *angular) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_vec3 p = dgfemi_vec3(0, 0, 0), l = p;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        const dgfem_vec3 *v = body->velocity + body->basis_start[e];
        dgfem_real density = body->material[e].density;
        for (int i = 0; i < form->count; i++) {
            dgfem_vec3 x = dgfemi_position_coefficient(body, e, i);
            p = dgfemi_add_scaled(p, density * mass[i], v[i]);
            for (int j = 0; j < form->count; j++)
                l = dgfemi_add_scaled(l, density * mass[i * form->count + j], dgfemi_cross(x, v[j]));
        }
    }
    if (linear) *linear = p;
    if (angular) *angular = l;
    return DGFEM_OK;
}

static dgfem_real dgfemi_kinetic_energy(const dgfem_body *body) {
    dgfem_real energy = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        const dgfem_vec3 *v = body->velocity + body->basis_start[e];
        for (int i = 0; i < form->count; i++)
            for (int j = 0; j < form->count; j++)
                energy += body->material[e].density * mass[i * form->count + j] * dgfemi_dot(v[i], v[j]) / 2;
    }
    return energy;
}

static dgfem_real dgfemi_gravity_energy(const dgfem_body *body) {
    dgfem_real energy = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *load = dgfemi_form_load(body->forms, e);
        for (int i = 0; i < form->count; i++)
            energy -= body->material[e].density * load[i] *
                      dgfemi_dot(body->desc.gravity, dgfemi_position_coefficient(body, e, i));
    }
    return energy;
}

/* Rotations of the current displacement in temporary memory; NULL when there is none. */
static dgfem_mat3 *dgfemi_rotations_now(const dgfem_body *body) {
    dgfem_mat3 *rotation =
        (dgfem_mat3 *)dgfemi_allocate(&body->hooks, (size_t)body->mesh->element_count, sizeof *rotation);
    if (rotation) dgfemi_rotations(body, rotation);
    return rotation;
}

DGFEM_API dgfem_status dgfem_body_energy(const dgfem_body *body, dgfem_energy *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_mat3 *rotation = dgfemi_rotations_now(body);
    if (!rotation) return dgfemi_fail_memory(&body->hooks);
    out->kinetic = dgfemi_kinetic_energy(body);
    out->elastic = dgfemi_elastic_energy(body, rotation, NULL);
    out->gravity = dgfemi_gravity_energy(body);
    dgfemi_free(&body->hooks, rotation);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_internal_force(const dgfem_body *body, dgfem_vec3 *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_mat3 *rotation = dgfemi_rotations_now(body);
    if (!rotation) return dgfemi_fail_memory(&body->hooks);
    memset(out, 0, (size_t)body->basis_count * sizeof *out);
    (void)dgfemi_elastic_energy(body, rotation, out);
    dgfemi_free(&body->hooks, rotation);
    return DGFEM_OK;
}

/* Deformed volume: for linear polynomials det F is constant in the element; for higher degrees its value at the
   centroid stands for the mean. */
DGFEM_API dgfem_real dgfem_body_volume(const dgfem_body *body) {
    dgfem_real volume = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 f = dgfem_body_gradient(body, e, body->origin[e]);
        volume += dgfemi_determinant(&f) * body->mesh->elements[e].volume;
    }
    return volume;
}
