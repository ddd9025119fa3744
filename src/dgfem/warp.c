#pragma once
#include "forms.c"
#include "sparse.c"
/* Stiffness warping: rotations of the elements, and the warped system assembled from the forms.

   With R the element's rotation, n' = R n, q' = R q, and  S' = R S R^T:

     element  K'_ij = lambda G'_ij + mu G'_ij^T + mu tr(G'_ij) I
     face     K1'_ij = -w (lambda n' q'^T + mu q' n'^T + mu (n'.q') I),  q' = R_s q^s_ij     (columns j of side s)
              K'_ij = K1'_ij + K1'_ji^T + P_ij S_stiff + Q_ij S_rest
              S_stiff = eta_stiff (mu I + (lambda + mu) N),  S_rest = eta_rest mu (I + N),
              N = (n_a' n_a'^T + n_b' n_b'^T) / 2, each with its own element's rotation

   All of this is linear in the integrals G_ij, q_ij, P_ij, Q_ij. So the 3x3 matrices that belong to each entry of the
   integrals, rotation and material included, are made once for an element or face, and its blocks are sums of them.

   The undeformed position is the polynomial X0 with linear coefficients scale * e_k. Stresses come from the
   displacement in the rotated frame, R^T (X0 + U) - X0, so that K' U - f0 is the internal force with
     f0_i = sum_j K'_ij (R - I) X0_j       over K'_ij of elements and K1'_ij of faces only. */

/* ---- rotations ---- */

/* Mean deformation gradient of an element: I + (1/V) int grad u. A derivative of a function is a multiple of another,
   so its integral is a multiple of a moment, which the load vector holds. About the centroid those of degree 1 vanish:
   only linear and cubic functions contribute. */
static dgfem_mat3 dgfemi_mean_gradient(const dgfem_body *body, int element) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_vec3 *u = body->displacement + body->basis_start[element];
    const dgfem_real *moments = dgfemi_form_load(body->forms, element);
    dgfem_real inverse = 1 / (body->scale[element] * moments[0]);
    dgfem_mat3 f = dgfemi_identity();
    for (int j = 1; j < form->count; j++)
        for (int a = 0; a < 3; a++) {
            int lower = dgfemi_derivative_index(j, a);
            if (lower == DGFEM_NONE) continue;
            dgfem_real d = (dgfem_real)dgfemi_exponents[j][a] * moments[lower] * inverse;
            f.m[0][a] += d * u[j].x;
            f.m[1][a] += d * u[j].y;
            f.m[2][a] += d * u[j].z;
        }
    return f;
}

typedef struct dgfemi_rotation_range {
    const dgfem_body *body;
    dgfem_mat3 *rotation;
} dgfemi_rotation_range;

static void dgfemi_rotations_in_range(void *context, int first, int last) {
    const dgfemi_rotation_range *range = (const dgfemi_rotation_range *)context;
    for (int e = first; e < last; e++)
        range->rotation[e] = dgfem_rotation_of(dgfemi_mean_gradient(range->body, e), range->body->rotation[e]);
}

/* Rotations of all elements for the current displacement; without warping all are the identity. */
static void dgfemi_rotations(const dgfem_body *body, dgfem_mat3 *rotation) {
    dgfemi_rotation_range range;
    range.body = body;
    range.rotation = rotation;
    if (body->desc.warp) {
        dgfemi_parallel_for(&body->hooks, body->mesh->element_count, 64, dgfemi_rotations_in_range, &range);
        return;
    }
    for (int e = 0; e < body->mesh->element_count; e++) rotation[e] = dgfemi_identity();
}

/* (R - I) X0_j for j = 1, 2, 3 */
static void dgfemi_rotated_rest(const dgfem_mat3 *r, dgfem_real scale, dgfem_vec3 out[3]) {
    for (int j = 0; j < 3; j++) {
        out[j] = dgfemi_scale(scale, dgfemi_column(r, j));
        if (j == 0) out[j].x -= scale;
        if (j == 1) out[j].y -= scale;
        if (j == 2) out[j].z -= scale;
    }
}

/* ---- blocks ---- */

/* k += lambda u v^T + mu v u^T + mu (u.v) I */
static void dgfemi_add_elastic(dgfem_real lambda, dgfem_real mu, dgfem_vec3 u, dgfem_vec3 v, dgfem_mat3 *k) {
    dgfem_real d = mu * dgfemi_dot(u, v);
    k->m[0][0] += (lambda + mu) * u.x * v.x + d;
    k->m[1][1] += (lambda + mu) * u.y * v.y + d;
    k->m[2][2] += (lambda + mu) * u.z * v.z + d;
    k->m[0][1] += lambda * u.x * v.y + mu * v.x * u.y;
    k->m[1][0] += lambda * u.y * v.x + mu * v.y * u.x;
    k->m[0][2] += lambda * u.x * v.z + mu * v.x * u.z;
    k->m[2][0] += lambda * u.z * v.x + mu * v.z * u.x;
    k->m[1][2] += lambda * u.y * v.z + mu * v.y * u.z;
    k->m[2][1] += lambda * u.z * v.y + mu * v.z * u.y;
}

/* That times a vector w. */
static dgfem_vec3 dgfemi_elastic_image(dgfem_real lambda, dgfem_real mu, dgfem_vec3 u, dgfem_vec3 v, dgfem_vec3 w) {
    dgfem_vec3 image = dgfemi_scale(lambda * dgfemi_dot(v, w), u);
    image = dgfemi_add_scaled(image, mu * dgfemi_dot(u, w), v);
    return dgfemi_add_scaled(image, mu * dgfemi_dot(u, v), w);
}

/* The unrotated K_ij times a vector. */
static dgfem_vec3 dgfemi_element_image(const dgfem_real *g, dgfem_real lambda, dgfem_real mu, dgfem_vec3 v) {
    dgfem_mat3 moment;
    memcpy(&moment, g, sizeof moment);
    dgfem_vec3 image = dgfemi_scale(lambda, dgfemi_multiply(&moment, v));
    image = dgfemi_add_scaled(image, mu, dgfemi_multiply_transposed(&moment, v));
    return dgfemi_add_scaled(image, mu * dgfemi_trace(&moment), v);
}

/* A face's form with today's rotations. */
typedef struct dgfemi_warped_face {
    const dgfemi_face_form *form;
    int sides; /* functions of both sides */
    int terms; /* integrals of each pair of functions, */
    const dgfem_real *pairs; /* and these, by rows of the lower triangle */
    dgfem_mat3 penalty_stiff, penalty_rest;
    dgfem_vec3 normal[2];        /* rotated with each side */
    dgfem_vec3 held;             /* the direction held where it is only one: the normal at rest, fixed in space */
    dgfem_real lambda[2], mu[2]; /* times -weight */
    const dgfem_mat3 *rotation[2];
} dgfemi_warped_face;

/* s (a I + b N) */
static dgfem_mat3 dgfemi_penalty_block(dgfem_real s, dgfem_real a, dgfem_real b, const dgfem_mat3 *n) {
    dgfem_mat3 p;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) p.m[i][j] = s * ((i == j ? a : 0) + b * n->m[i][j]);
    return p;
}

static void dgfemi_warp_face_penalty(const dgfem_body *body, dgfemi_warped_face *face) {
    const dgfemi_face_form *form = face->form;
    int b = form->element[1] == DGFEM_NONE ? form->element[0] : form->element[1];
    const dgfem_material *ma = &body->material[form->element[0]], *mb = &body->material[b];
    dgfem_real mu = dgfemi_max(dgfemi_mu(ma), dgfemi_mu(mb));
    dgfem_real lambda = dgfemi_max(dgfemi_lambda(ma), dgfemi_lambda(mb));
    dgfem_mat3 n;
    memset(&n, 0, sizeof n);
    dgfemi_add_outer(&n, DGFEM_R(0.5), face->normal[0], face->normal[0]);
    dgfemi_add_outer(&n, DGFEM_R(0.5), face->normal[1], face->normal[1]);
    if (body->desc.penalty == DGFEM_PENALTY_SCALAR)
        face->penalty_stiff = dgfemi_penalty_block(form->eta_stiff, lambda + 2 * mu, 0, &n);
    else face->penalty_stiff = dgfemi_penalty_block(form->eta_stiff, mu, lambda + mu, &n);
    face->penalty_rest = dgfemi_penalty_block(form->eta_rest * mu, 1, 1, &n);
    if (!form->normal_only) return;
    memset(&n, 0, sizeof n);
    dgfemi_add_outer(&n, 1, face->held, face->held);
    face->penalty_stiff = dgfemi_penalty_block(form->eta_stiff, 0, lambda + 2 * mu, &n);
    face->penalty_rest = dgfemi_penalty_block(form->eta_rest, 0, 2 * mu, &n);
}

static void dgfemi_warp_face(const dgfem_body *body, const dgfemi_face_form *form, const dgfem_mat3 *rotation,
                             dgfemi_warped_face *face) {
    const dgfem_forms *forms = body->forms;
    dgfem_vec3 n = body->mesh->faces[form->face].normal;
    face->form = form;
    face->held = n;
    face->sides = form->count[0] + form->count[1];
    face->terms = dgfemi_form_terms(form);
    face->pairs = dgfemi_form_pair(forms, form, 0, 0);
    for (int s = 0; s < 2; s++) {
        int element = form->element[s] == DGFEM_NONE ? form->element[0] : form->element[s];
        const dgfem_mat3 *r = &rotation[element];
        const dgfem_material *m = &body->material[element];
        face->normal[s] = dgfemi_multiply(r, n);
        face->lambda[s] = -form->weight * dgfemi_lambda(m);
        face->mu[s] = -form->weight * dgfemi_mu(m);
        face->rotation[s] = r;
    }
    dgfemi_warp_face_penalty(body, face);
}

/* The integrals of functions i >= j, counting those of both sides. */
static const dgfem_real *dgfemi_face_pair(const dgfemi_warped_face *face, int i, int j) {
    return face->pairs + face->terms * (i * (i + 1) / 2 + j);
}

/* q^s_ij: i counts the functions of both sides, j >= 1 those of side s. */
static dgfem_vec3 dgfemi_face_integral(const dgfemi_warped_face *face, int s, int i, int j) {
    int k = s ? face->form->count[0] + j : j;
    const dgfem_real *q = i >= k ? dgfemi_face_pair(face, i, k) + 2 : dgfemi_face_pair(face, k, i) + 5;
    return dgfemi_vec3(q[0], q[1], q[2]);
}

/* That rotated. */
static dgfem_vec3 dgfemi_face_traction(const dgfemi_warped_face *face, int s, int i, int j) {
    return dgfemi_multiply(face->rotation[s], dgfemi_face_integral(face, s, i, j));
}

/* Row vector of K1'_ij where only the component along `held` is kept: K1'_ij = held w^T. */
static dgfem_vec3 dgfemi_held_row(const dgfemi_warped_face *face, int s, dgfem_vec3 q) {
    return dgfemi_elastic_image(face->lambda[s], face->mu[s], q, face->normal[s], face->held);
}

/* k += K1'_ij, with q the traction vector of i and j */
static void dgfemi_add_consistency(const dgfemi_warped_face *face, int s, dgfem_vec3 q, dgfem_mat3 *k) {
    if (face->form->normal_only) dgfemi_add_outer(k, 1, face->held, dgfemi_held_row(face, s, q));
    else dgfemi_add_elastic(face->lambda[s], face->mu[s], face->normal[s], q, k);
}

/* k += K1'_ij^T */
static void dgfemi_add_adjoint(const dgfemi_warped_face *face, int s, dgfem_vec3 q, dgfem_mat3 *k) {
    if (face->form->normal_only) dgfemi_add_outer(k, 1, dgfemi_held_row(face, s, q), face->held);
    else dgfemi_add_elastic(face->lambda[s], face->mu[s], q, face->normal[s], k);
}

/* K1'_ij v */
static dgfem_vec3 dgfemi_consistency_image(const dgfemi_warped_face *face, int s, dgfem_vec3 q, dgfem_vec3 v) {
    if (face->form->normal_only) return dgfemi_scale(dgfemi_dot(dgfemi_held_row(face, s, q), v), face->held);
    return dgfemi_elastic_image(face->lambda[s], face->mu[s], face->normal[s], q, v);
}

/* K1'_ij^T v */
static dgfem_vec3 dgfemi_adjoint_image(const dgfemi_warped_face *face, int s, dgfem_vec3 q, dgfem_vec3 v) {
    if (face->form->normal_only) return dgfemi_scale(dgfemi_dot(face->held, v), dgfemi_held_row(face, s, q));
    return dgfemi_elastic_image(face->lambda[s], face->mu[s], q, face->normal[s], v);
}

/* sum_j (P_ij S_stiff + Q_ij S_rest) u_j over the functions of side s; i counts those of both sides. */
static dgfem_vec3 dgfemi_jump_image(const dgfemi_warped_face *face, int i, int s, const dgfem_vec3 *u) {
    int first = s ? face->form->count[0] : 0;
    dgfem_vec3 stiff = dgfemi_vec3(0, 0, 0), rest = stiff;
    for (int j = 0; j < face->form->count[s]; j++) {
        int k = first + j;
        const dgfem_real *pair = i >= k ? dgfemi_face_pair(face, i, k) : dgfemi_face_pair(face, k, i);
        stiff = dgfemi_add_scaled(stiff, pair[0], u[j]);
        rest = dgfemi_add_scaled(rest, pair[1], u[j]);
    }
    return dgfemi_add(dgfemi_multiply(&face->penalty_stiff, stiff), dgfemi_multiply(&face->penalty_rest, rest));
}

/* ---- assembly ---- */

/* out += k, a 3x3 matrix in a row-major one with `columns` columns */
DGFEM_INLINE void dgfemi_add_block(dgfem_real *out, int columns, const dgfem_real *k) {
    for (int p = 0; p < 3; p++, out += columns, k += 3) out[0] += k[0], out[1] += k[1], out[2] += k[2];
}

/* out += k^T */
DGFEM_INLINE void dgfemi_add_block_transposed(dgfem_real *out, int columns, const dgfem_real *k) {
    for (int p = 0; p < 3; p++, out += columns, k++) out[0] += k[0], out[1] += k[3], out[2] += k[6];
}

/* The lower triangle of K_w of an element: with r_c the columns of R, the entry G_cd belongs to
   lambda r_c r_d^T + mu r_d r_c^T + mu (r_c.r_d) I. */
static void dgfemi_assemble_element(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_real s,
                                    const dgfemi_kernels *kernels, dgfem_matrix *matrix) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_real *g = dgfemi_form_stiffness(body->forms, element);
    const dgfem_material *m = &body->material[element];
    dgfem_real lambda = s * dgfemi_lambda(m), mu = s * dgfemi_mu(m);
    dgfem_real terms[9 * DGFEM_MATRIX_STRIDE] = {0}, k[DGFEM_MAX_BASIS * DGFEM_MATRIX_STRIDE];
    dgfem_real *out = dgfem_matrix_block(matrix, element, element);
    int columns = 3 * form->count;
    for (int c = 0; c < 9; c++) {
        dgfem_mat3 term;
        memset(&term, 0, sizeof term);
        dgfemi_add_elastic(lambda, mu, dgfemi_column(r, c / 3), dgfemi_column(r, c % 3), &term);
        memcpy(terms + c * DGFEM_MATRIX_STRIDE, &term, sizeof term);
    }
    for (int i = 1; i < form->count; i++, g += 9 * (form->count - 1)) {
        kernels->combine(g, i, 9, terms, k);
        for (int j = 1; j <= i; j++)
            dgfemi_add_block(out + 3 * (i * columns + j), columns, k + (j - 1) * DGFEM_MATRIX_STRIDE);
    }
}

/* Diagonal blocks are summed in their lower triangles. */
static void dgfemi_mirror_diagonal(dgfem_matrix *matrix) {
    for (int r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        dgfem_real *block = matrix->values + matrix->value_start[dgfemi_diagonal_index(matrix, r)];
        for (int i = 0; i < n; i++)
            for (int j = 0; j < i; j++) block[j * n + i] = block[i * n + j];
    }
}

/* f0 of an element, in its own frame until the end: R K R^T (R - I) X0 = R K (I - R^T) X0. */
static void dgfemi_element_rest_force(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_vec3 *f0) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_real *g = dgfemi_form_stiffness(body->forms, element);
    const dgfem_material *m = &body->material[element];
    dgfem_real lambda = dgfemi_lambda(m), mu = dgfemi_mu(m);
    dgfem_vec3 rest[3];
    dgfemi_rotated_rest(r, body->scale[element], rest);
    for (int j = 0; j < 3; j++) rest[j] = dgfemi_multiply_transposed(r, rest[j]);
    f0 += body->basis_start[element];
    for (int i = 1; i < form->count; i++, g += 9 * (form->count - 1)) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int j = 0; j < 3; j++) sum = dgfemi_add(sum, dgfemi_element_image(g + 9 * j, lambda, mu, rest[j]));
        f0[i] = dgfemi_add(f0[i], dgfemi_multiply(r, sum));
    }
}

/* The matrices that the integrals of a pair of functions belong to, in their order: for rows of side r and columns of
   side s = 00, 10, 11. */
typedef struct dgfemi_face_terms {
    dgfem_real quadrant[3][8 * DGFEM_MATRIX_STRIDE];
} dgfemi_face_terms;

static void dgfemi_set_terms(const dgfemi_warped_face *face, dgfem_real scale, dgfemi_face_terms *terms) {
    dgfem_mat3 penalty[2], traction[2][3], adjoint[2][3];
    memset(traction, 0, sizeof traction);
    memset(adjoint, 0, sizeof adjoint);
    for (int p = 0; p < 9; p++) {
        penalty[0].m[p / 3][p % 3] = scale * face->penalty_stiff.m[p / 3][p % 3];
        penalty[1].m[p / 3][p % 3] = scale * face->penalty_rest.m[p / 3][p % 3];
    }
    for (int s = 0; s < 2; s++)
        for (int d = 0; d < 3 && dgfemi_form_has_traction(face->form, s); d++) {
            dgfem_vec3 q = dgfemi_scale(scale, dgfemi_column(face->rotation[s], d));
            dgfemi_add_consistency(face, s, q, &traction[s][d]);
            dgfemi_add_adjoint(face, s, q, &adjoint[s][d]);
        }
    for (int k = 0; k < 3; k++) {
        dgfem_real *to = terms->quadrant[k];
        int r = k > 0, s = k > 1;
        for (int t = 0; t < 2; t++, to += DGFEM_MATRIX_STRIDE) memcpy(to, &penalty[t], sizeof penalty[t]);
        for (int d = 0; d < 3; d++, to += DGFEM_MATRIX_STRIDE) memcpy(to, &traction[s][d], sizeof traction[s][d]);
        for (int d = 0; d < 3; d++, to += DGFEM_MATRIX_STRIDE) memcpy(to, &adjoint[r][d], sizeof adjoint[r][d]);
    }
}

/* The lower triangle of a diagonal block: the functions first <= i < first + count of the face's. */
static void dgfemi_assemble_face_diagonal(const dgfemi_warped_face *face, int first, int count,
                                          const dgfem_real *terms, const dgfemi_kernels *kernels, dgfem_real *out) {
    dgfem_real k[DGFEM_MAX_BASIS * DGFEM_MATRIX_STRIDE];
    for (int i = 0; i < count; i++) {
        kernels->combine(dgfemi_face_pair(face, first + i, first), i + 1, face->terms, terms, k);
        for (int j = 0; j <= i; j++)
            dgfemi_add_block(out + 3 * (3 * i * count + j), 3 * count, k + j * DGFEM_MATRIX_STRIDE);
    }
}

/* The block that couples both sides: rows of side 1, or where its element comes first, of side 0. */
static void dgfemi_assemble_face_coupling(const dgfemi_warped_face *face, const dgfem_real *terms,
                                          const dgfemi_kernels *kernels, dgfem_matrix *matrix) {
    const dgfemi_face_form *form = face->form;
    int a = form->element[0], b = form->element[1], n = form->count[0], m = form->count[1];
    dgfem_real k[DGFEM_MAX_BASIS * DGFEM_MATRIX_STRIDE];
    dgfem_real *out = b > a ? dgfem_matrix_block(matrix, b, a) : dgfem_matrix_block(matrix, a, b);
    for (int i = 0; i < m; i++) {
        kernels->combine(dgfemi_face_pair(face, n + i, 0), n, face->terms, terms, k);
        for (int j = 0; j < n; j++) {
            const dgfem_real *block = k + j * DGFEM_MATRIX_STRIDE;
            if (b > a) dgfemi_add_block(out + 3 * (3 * i * n + j), 3 * n, block);
            else dgfemi_add_block_transposed(out + 3 * (3 * j * m + i), 3 * m, block);
        }
    }
}

/* f0 of the consistency terms of side s, for the rows of both sides: linear in the entries of q_ij, j = 1, 2, 3, too. */
static void dgfemi_face_rest_force(const dgfem_body *body, const dgfemi_warped_face *face, int s,
                                   const dgfem_mat3 *rotation, dgfem_vec3 *f0) {
    const dgfemi_face_form *form = face->form;
    dgfem_vec3 rest[3], terms[9];
    int element = form->element[s];
    dgfemi_rotated_rest(&rotation[element], body->scale[element], rest);
    for (int c = 0; c < 9; c++)
        terms[c] = dgfemi_consistency_image(face, s, dgfemi_column(&rotation[element], c % 3), rest[c / 3]);
    for (int r = 0; r < 2 && form->element[r] != DGFEM_NONE; r++) {
        dgfem_vec3 *out = f0 + body->basis_start[form->element[r]];
        for (int i = 0; i < form->count[r]; i++) {
            for (int j = 0; j < 3; j++) {
                dgfem_vec3 q = dgfemi_face_integral(face, s, r ? form->count[0] + i : i, j + 1);
                out[i] = dgfemi_add_scaled(out[i], q.x, terms[3 * j]);
                out[i] = dgfemi_add_scaled(out[i], q.y, terms[3 * j + 1]);
                out[i] = dgfemi_add_scaled(out[i], q.z, terms[3 * j + 2]);
            }
        }
    }
}

/* Right-hand side of a held face: minus the column of the ghost times the prescribed displacement. */
static void dgfemi_held_force(const dgfem_body *body, const dgfemi_warped_face *face, dgfem_real factor,
                              dgfem_vec3 *f) {
    const dgfemi_face_form *form = face->form;
    const dgfem_vec3 *ghost = dgfemi_form_ghost(body->forms, form);
    f += body->basis_start[form->element[0]];
    for (int i = 0; i < form->count[0]; i++) {
        dgfem_vec3 sum = dgfemi_jump_image(face, i, 1, ghost);
        for (int j = 0; j < form->count[1] && i > 0 && dgfemi_form_has_traction(form, 0); j++) {
            dgfem_vec3 q = dgfemi_face_traction(face, 0, form->count[0] + j, i);
            sum = dgfemi_add(sum, dgfemi_adjoint_image(face, 0, q, ghost[j]));
        }
        f[i] = dgfemi_add_scaled(f[i], -factor, sum);
    }
}

/* matrix = scale * K_w; f0 (may be NULL) = warping's force plus `factor` times that of prescribed displacements. */
static void dgfemi_assemble_stiffness(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_real scale,
                                      dgfem_real factor, dgfem_matrix *matrix, dgfem_vec3 *f0) {
    const dgfem_forms *forms = body->forms;
    const dgfemi_kernels *kernels = dgfemi_kernels_choose(DGFEM_SIMD_AUTO);
    dgfemi_warped_face face;
    dgfemi_face_terms terms;
    memset(&terms, 0, sizeof terms);
    dgfem_matrix_clear(matrix);
    if (f0) memset(f0, 0, (size_t)body->basis_count * sizeof *f0);
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfemi_assemble_element(body, e, &rotation[e], scale, kernels, matrix);
        if (f0 && body->desc.warp) dgfemi_element_rest_force(body, e, &rotation[e], f0);
    }
    for (int f = 0; f < forms->face_count; f++) {
        const dgfemi_face_form *form = &forms->faces[f];
        int a = form->element[0], b = form->element[1], n = form->count[0];
        dgfemi_warp_face(body, form, rotation, &face);
        dgfemi_set_terms(&face, scale, &terms);
        dgfemi_assemble_face_diagonal(&face, 0, n, terms.quadrant[0], kernels, dgfem_matrix_block(matrix, a, a));
        if (b != DGFEM_NONE) {
            dgfemi_assemble_face_coupling(&face, terms.quadrant[1], kernels, matrix);
            dgfemi_assemble_face_diagonal(&face, n, form->count[1], terms.quadrant[2], kernels,
                                          dgfem_matrix_block(matrix, b, b));
        } else if (f0) {
            dgfemi_held_force(body, &face, factor, f0);
        }
        for (int s = 0; s < 2 && f0 && body->desc.warp; s++)
            if (dgfemi_form_has_traction(form, s)) dgfemi_face_rest_force(body, &face, s, rotation, f0);
    }
    dgfemi_mirror_diagonal(matrix);
}

/* Adds s * (mass matrix) to the diagonal blocks. */
static void dgfemi_assemble_mass(const dgfem_body *body, dgfem_real s, dgfem_matrix *matrix) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        dgfem_real *out = dgfem_matrix_block(matrix, e, e), factor = s * body->material[e].density;
        int n = form->count;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int a = 0; a < 3; a++) out[(3 * i + a) * 3 * n + 3 * j + a] += factor * mass[i * n + j];
    }
}

static double dgfemi_total_mass(const dgfem_body *body) {
    double mass = 0;
    for (int e = 0; e < body->mesh->element_count; e++)
        mass += (double)(body->material[e].density * dgfemi_form_mass(body->forms, e)[0]);
    return mass;
}

/* v . M v */
static double dgfemi_mass_norm(const dgfem_body *body, const dgfem_vec3 *v) {
    double norm = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        const dgfem_vec3 *u = v + body->basis_start[e];
        dgfem_real sum = 0;
        for (int i = 0; i < form->count; i++)
            for (int j = 0; j < form->count; j++) sum += mass[i * form->count + j] * dgfemi_dot(u[i], u[j]);
        norm += (double)(body->material[e].density * sum);
    }
    return norm;
}

/* out += s M v */
static void dgfemi_add_mass_product(const dgfem_body *body, dgfem_real s, const dgfem_vec3 *v, dgfem_vec3 *out) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        dgfem_real factor = s * body->material[e].density;
        int start = body->basis_start[e];
        for (int i = 0; i < form->count; i++)
            for (int j = 0; j < form->count; j++)
                out[start + i] = dgfemi_add_scaled(out[start + i], factor * mass[i * form->count + j], v[start + j]);
    }
}

/* ---- force and energy without a matrix ---- */

/* U - (R - I) X0: the displacement seen in the rotated frame, turned back to world axes. */
static void dgfemi_strained(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_vec3 *out) {
    const dgfem_vec3 *u = body->displacement + body->basis_start[element];
    dgfem_vec3 rest[3];
    dgfemi_rotated_rest(r, body->scale[element], rest);
    for (int j = 0; j < body->forms->elements[element].count; j++)
        out[j] = j >= 1 && j <= 3 ? dgfemi_sub(u[j], rest[j - 1]) : u[j];
}

/* Elastic energy of one element, in its own frame; adds its internal force K_w U - f0 where `force` is not NULL. */
static dgfem_real dgfemi_element_energy(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_vec3 *force) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_real *g = dgfemi_form_stiffness(body->forms, element);
    const dgfem_material *m = &body->material[element];
    dgfem_real lambda = dgfemi_lambda(m), mu = dgfemi_mu(m), energy = 0;
    dgfem_vec3 strained[DGFEM_MAX_BASIS];
    dgfemi_strained(body, element, r, strained);
    for (int j = 1; j < form->count; j++) strained[j] = dgfemi_multiply_transposed(r, strained[j]);
    for (int i = 1; i < form->count; i++) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int j = 1; j < form->count; j++, g += 9)
            sum = dgfemi_add(sum, dgfemi_element_image(g, lambda, mu, strained[j]));
        energy += dgfemi_dot(strained[i], sum) / 2;
        if (!force) continue;
        dgfem_vec3 *out = &force[body->basis_start[element] + i];
        *out = dgfemi_add(*out, dgfemi_multiply(r, sum));
    }
    return energy;
}

/* The same of one face. With U the displacement (of a ghost: `factor` times what is prescribed) and U' its strained
   part:  force = K3 U + K1' U' + K1'^T U,  energy = U.K3 U / 2 + U.K1' U'. */
static dgfem_real dgfemi_face_energy(const dgfem_body *body, const dgfemi_warped_face *face, const dgfem_mat3 *rotation,
                                     dgfem_real factor, dgfem_vec3 *force) {
    const dgfemi_face_form *form = face->form;
    dgfem_vec3 strained[2][DGFEM_MAX_BASIS];
    const dgfem_vec3 *u[2];
    dgfem_real energy = 0;
    for (int s = 0; s < 2; s++) {
        int e = form->element[s];
        u[s] = e == DGFEM_NONE ? strained[s] : body->displacement + body->basis_start[e];
        if (e != DGFEM_NONE) dgfemi_strained(body, e, &rotation[e], strained[s]);
        for (int j = 0; e == DGFEM_NONE && j < form->count[s]; j++)
            strained[s][j] = dgfemi_scale(factor, dgfemi_form_ghost(body->forms, form)[j]);
    }
    for (int r = 0; r < 2; r++)
        for (int i = 0; i < form->count[r]; i++) {
            dgfem_vec3 penalty = dgfemi_vec3(0, 0, 0), traction = penalty, adjoint = penalty;
            int row = r ? form->count[0] + i : i;
            for (int s = 0; s < 2; s++) {
                penalty = dgfemi_add(penalty, dgfemi_jump_image(face, row, s, u[s]));
                for (int j = 1; j < form->count[s] && dgfemi_form_has_traction(form, s); j++) {
                    dgfem_vec3 q = dgfemi_face_traction(face, s, row, j);
                    traction = dgfemi_add(traction, dgfemi_consistency_image(face, s, q, strained[s][j]));
                }
                for (int j = 0; j < form->count[s] && i > 0 && dgfemi_form_has_traction(form, r); j++) {
                    dgfem_vec3 q = dgfemi_face_traction(face, r, s ? form->count[0] + j : j, i);
                    adjoint = dgfemi_add(adjoint, dgfemi_adjoint_image(face, r, q, u[s][j]));
                }
            }
            energy += dgfemi_dot(u[r][i], dgfemi_add_scaled(traction, DGFEM_R(0.5), penalty));
            if (force && form->element[r] != DGFEM_NONE) {
                dgfem_vec3 *out = &force[body->basis_start[form->element[r]] + i];
                *out = dgfemi_add(*out, dgfemi_add(penalty, dgfemi_add(traction, adjoint)));
            }
        }
    return energy;
}

/* Energy of all elements and faces, with `factor` times the prescribed displacements; adds the internal force where
   `force` is not NULL. */
static dgfem_real dgfemi_elastic_energy(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_real factor,
                                        dgfem_vec3 *force) {
    dgfemi_warped_face face;
    dgfem_real energy = 0;
    for (int e = 0; e < body->mesh->element_count; e++) energy += dgfemi_element_energy(body, e, &rotation[e], force);
    for (int f = 0; f < body->forms->face_count; f++) {
        dgfemi_warp_face(body, &body->forms->faces[f], rotation, &face);
        energy += dgfemi_face_energy(body, &face, rotation, factor, force);
    }
    return energy;
}
