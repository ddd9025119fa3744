#pragma once
#include "solve.c"
/* Asking a solid: fields at a point, energies, momenta, volume, internal force; setting affine fields. */

/* ---- queries ---- */

/* Whether there is such an element, and the rest position is finite; the other answers are logged. */
static int dgfemi_can_ask(const dgfem_body *body, int element, dgfem_vec3 rest, const char *what) {
    if (!body) return 0;
    if (element < 0 || element >= body->mesh->element_count)
        (void)dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "%s: element %d, expected 0..%d", what, element,
                          body->mesh->element_count - 1);
    else if (!dgfemi_is_finite3(rest))
        (void)dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s: rest position (%g, %g, %g)", what, (double)rest.x,
                          (double)rest.y, (double)rest.z);
    else return 1;
    return 0;
}

static dgfem_mat3 dgfemi_zero_mat3(void) {
    dgfem_mat3 zero;
    memset(&zero, 0, sizeof zero);
    return zero;
}

DGFEM_API dgfem_vec3 dgfem_body_displacement(const dgfem_body *body, int element, dgfem_vec3 rest) {
    if (!dgfemi_can_ask(body, element, rest, "displacement")) return dgfemi_vec3(0, 0, 0);
    return dgfemi_evaluate(body, body->displacement, element, rest);
}

DGFEM_API dgfem_vec3 dgfem_body_velocity(const dgfem_body *body, int element, dgfem_vec3 rest) {
    if (!dgfemi_can_ask(body, element, rest, "velocity")) return dgfemi_vec3(0, 0, 0);
    return dgfemi_evaluate(body, body->velocity, element, rest);
}

static dgfem_mat3 dgfemi_gradient(const dgfem_body *body, int element, dgfem_vec3 rest) {
    dgfem_vec3 gradients[DGFEM_MAX_BASIS];
    dgfem_mat3 f = dgfemi_identity();
    int start = body->basis_start[element];
    dgfemi_basis_gradients(body->degree[element], body->origin[element], body->scale[element], rest, gradients);
    for (int i = 1; i < body->basis_start[element + 1] - start; i++)
        dgfemi_add_outer(&f, 1, body->displacement[start + i], gradients[i]);
    return f;
}

DGFEM_API dgfem_mat3 dgfem_body_gradient(const dgfem_body *body, int element, dgfem_vec3 rest) {
    if (!dgfemi_can_ask(body, element, rest, "gradient")) return dgfemi_identity();
    return dgfemi_gradient(body, element, rest);
}

/* The current rotation of one element: that of its displacement now, not of the last step's start. */
static dgfem_mat3 dgfemi_rotation_now(const dgfem_body *body, int element) {
    if (!body->desc.warp) return dgfemi_identity();
    return dgfem_rotation_of(dgfemi_mean_gradient(body, element), body->rotation[element]);
}

/* Strain of a deformation gradient in the element's rotated frame: sym(R^T F) - I. */
static dgfem_mat3 dgfemi_rotated_strain(const dgfem_mat3 *r, const dgfem_mat3 *f) {
    dgfem_mat3 rt = dgfemi_transposed(r), stretch = dgfemi_multiply3(&rt, f), strain;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) strain.m[i][j] = (stretch.m[i][j] + stretch.m[j][i]) / 2 - (i == j ? 1 : 0);
    return strain;
}

/* R a R^T: from the element's rotated frame to world axes. */
static dgfem_mat3 dgfemi_to_world(const dgfem_mat3 *r, const dgfem_mat3 *a) {
    dgfem_mat3 rt = dgfemi_transposed(r), ra = dgfemi_multiply3(r, a);
    return dgfemi_multiply3(&ra, &rt);
}

static dgfem_mat3 dgfemi_strain_of(const dgfem_body *body, int element, const dgfem_mat3 *f) {
    dgfem_mat3 r = dgfemi_rotation_now(body, element), strain = dgfemi_rotated_strain(&r, f);
    return dgfemi_to_world(&r, &strain);
}

static dgfem_mat3 dgfemi_stress_of(const dgfem_body *body, int element, const dgfem_mat3 *f) {
    dgfem_mat3 r = dgfemi_rotation_now(body, element), stress = dgfemi_rotated_strain(&r, f);
    dgfem_real mu = dgfemi_mu(&body->material[element]);
    dgfem_real volumetric = dgfemi_lambda(&body->material[element]) * dgfemi_trace(&stress);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) stress.m[i][j] = 2 * mu * stress.m[i][j] + (i == j ? volumetric : 0);
    return dgfemi_to_world(&r, &stress);
}

DGFEM_API dgfem_mat3 dgfem_body_strain(const dgfem_body *body, int element, dgfem_vec3 rest) {
    if (!dgfemi_can_ask(body, element, rest, "strain")) return dgfemi_zero_mat3();
    dgfem_mat3 f = dgfemi_gradient(body, element, rest);
    return dgfemi_strain_of(body, element, &f);
}

DGFEM_API dgfem_mat3 dgfem_body_stress(const dgfem_body *body, int element, dgfem_vec3 rest) {
    if (!dgfemi_can_ask(body, element, rest, "stress")) return dgfemi_zero_mat3();
    dgfem_mat3 f = dgfemi_gradient(body, element, rest);
    return dgfemi_stress_of(body, element, &f);
}

/* Strain and stress are linear in the gradient, so their means are those of its mean. */
DGFEM_API dgfem_mat3 dgfem_body_mean_strain(const dgfem_body *body, int element) {
    if (!dgfemi_can_ask(body, element, dgfemi_vec3(0, 0, 0), "mean_strain")) return dgfemi_zero_mat3();
    dgfem_mat3 f = dgfemi_mean_gradient(body, element);
    return dgfemi_strain_of(body, element, &f);
}

DGFEM_API dgfem_mat3 dgfem_body_mean_stress(const dgfem_body *body, int element) {
    if (!dgfemi_can_ask(body, element, dgfemi_vec3(0, 0, 0), "mean_stress")) return dgfemi_zero_mat3();
    dgfem_mat3 f = dgfemi_mean_gradient(body, element);
    return dgfemi_stress_of(body, element, &f);
}

DGFEM_API void dgfem_body_principal_stress(const dgfem_body *body, int element, dgfem_vec3 rest, dgfem_real values[3],
                                           dgfem_mat3 *directions) {
    dgfem_mat3 vectors;
    dgfem_eigen_symmetric(dgfem_body_stress(body, element, rest), values, directions ? directions : &vectors);
}

DGFEM_API void dgfem_body_mean_principal_stress(const dgfem_body *body, int element, dgfem_real values[3],
                                                dgfem_mat3 *directions) {
    dgfem_mat3 vectors;
    dgfem_eigen_symmetric(dgfem_body_mean_stress(body, element), values, directions ? directions : &vectors);
}

DGFEM_API dgfem_mat3 dgfem_body_rotation(const dgfem_body *body, int element) {
    if (!dgfemi_can_ask(body, element, dgfemi_vec3(0, 0, 0), "rotation")) return dgfemi_identity();
    return dgfemi_rotation_now(body, element);
}

DGFEM_API dgfem_vec3 dgfem_body_face_displacement(const dgfem_body *body, int face) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    if (!body) return sum;
    if (face < 0 || face >= body->mesh->face_count) {
        (void)dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "face_displacement: face %d, expected 0..%d", face,
                          body->mesh->face_count - 1);
        return sum;
    }
    const dgfem_face *f = &body->mesh->faces[face];
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

/* Coefficient i of the element's deformed position x + u(x), where x = origin + scale * (linear monomials). */
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
    for (int e = 0; body && e < body->mesh->element_count; e++)
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

DGFEM_API dgfem_status dgfem_body_energy(const dgfem_body *body, dgfem_energy *out) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_out(&body->hooks, out, "energy");
    if (status) return status;
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    out->kinetic = (dgfem_real)(dgfemi_mass_norm(body, body->velocity) / 2);
    out->elastic = dgfemi_elastic_energy(body, dgfemi_next_rotation(body), 1, NULL);
    out->gravity = dgfemi_gravity_energy(body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_internal_force(const dgfem_body *body, dgfem_vec3 *out) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_out(&body->hooks, out, "internal_force");
    if (status) return status;
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    memset(out, 0, (size_t)body->basis_count * sizeof *out);
    (void)dgfemi_elastic_energy(body, dgfemi_next_rotation(body), 1, out);
    return DGFEM_OK;
}

/* Deformed volume: for linear polynomials det F is constant in the element; for higher degrees its value at the
   centroid stands for the mean. */
DGFEM_API dgfem_real dgfem_body_volume(const dgfem_body *body) {
    dgfem_real volume = 0;
    for (int e = 0; body && e < body->mesh->element_count; e++) {
        dgfem_mat3 f = dgfemi_gradient(body, e, body->origin[e]);
        volume += dgfemi_determinant(&f) * body->mesh->elements[e].volume;
    }
    return volume;
}

DGFEM_API dgfem_status dgfem_body_element_mass(const dgfem_body *body, int element, dgfem_real *out) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_out(&body->hooks, out, "element_mass");
    if (status) return status;
    if (element < 0 || element >= body->mesh->element_count)
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "mass: element %d of %d", element,
                           body->mesh->element_count);
    const dgfem_real *mass = dgfemi_form_mass(body->forms, element);
    int count = body->forms->elements[element].count;
    for (int i = 0; i < count * count; i++) out[i] = body->material[element].density * mass[i];
    return DGFEM_OK;
}
