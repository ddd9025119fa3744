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
    dgfem_real inverse = 1 / (body->scale[element] * moments[0]), slope = 1 / body->scale[element];
    dgfem_mat3 f = dgfemi_identity();
    for (int a = 0; a < 3; a++) {
        f.m[0][a] += slope * u[1 + a].x;
        f.m[1][a] += slope * u[1 + a].y;
        f.m[2][a] += slope * u[1 + a].z;
    }
    for (int j = 4; j < form->count; j++)
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

/* Of the stiffer side. */
static void dgfemi_warp_face_penalty(const dgfem_body *body, const dgfem_real *lambdas, const dgfem_real *mus,
                                     dgfemi_warped_face *face) {
    const dgfemi_face_form *form = face->form;
    dgfem_real mu = dgfemi_max(mus[0], mus[1]), lambda = dgfemi_max(lambdas[0], lambdas[1]);
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
    dgfem_real lambda[2], mu[2];
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
        lambda[s] = dgfemi_lambda(m), mu[s] = dgfemi_mu(m);
        face->lambda[s] = -form->weight * lambda[s];
        face->mu[s] = -form->weight * mu[s];
        face->rotation[s] = r;
    }
    dgfemi_warp_face_penalty(body, lambda, mu, face);
}

/* The integrals of functions i >= j, counting those of both sides. */
static const dgfem_real *dgfemi_face_pair(const dgfemi_warped_face *face, int i, int j) {
    return face->pairs + face->terms * (i * (i + 1) / 2 + j);
}

/* q^s_ij: i counts the functions of both sides, j >= 1 those of side s. */
static const dgfem_real *dgfemi_face_integral(const dgfemi_warped_face *face, int s, int i, int j) {
    int k = s ? face->form->count[0] + j : j;
    return i >= k ? dgfemi_face_pair(face, i, k) + 2 : dgfemi_face_pair(face, k, i) + 5;
}

/* That rotated. */
static dgfem_vec3 dgfemi_face_traction(const dgfemi_warped_face *face, int s, int i, int j) {
    const dgfem_real *q = dgfemi_face_integral(face, s, i, j);
    return dgfemi_multiply(face->rotation[s], dgfemi_vec3(q[0], q[1], q[2]));
}

/* Row vector of K1'_ij where only the component along `held` is kept: K1'_ij = held w^T. */
static dgfem_vec3 dgfemi_held_row(const dgfemi_warped_face *face, int s, dgfem_vec3 q) {
    return dgfemi_elastic_image(face->lambda[s], face->mu[s], q, face->normal[s], face->held);
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

/* One assembly. It goes through the matrix row by row, so that what it adds to is in cache: a face comes with the row
   of its later element. Of several threads each has its chunks of rows; then a face between two chunks is computed for
   both of them, for the earlier one after all others. So every block and every force receives its parts in the same
   order, whatever the chunks. */
typedef struct dgfemi_assembly {
    const dgfem_body *body;
    const dgfem_mat3 *rotation;
    dgfem_real scale, factor;
    dgfem_matrix *matrix;
    dgfem_vec3 *f0; /* or NULL */
    const dgfemi_kernels *kernels;
    int late[DGFEM_MOST_CHUNKS]; /* the first face between each chunk and a later one, or DGFEM_NONE */
} dgfemi_assembly;

/* The matrices that the integrals of a pair of functions belong to: those of the penalty; of the tractions of each
   side, for the columns of a pair; their transposes, for its rows. And what the tractions make of (R - I) X0_j: a vector
   for each j and entry. */
typedef struct dgfemi_face_terms {
    dgfem_real penalty[2 * DGFEM_MATRIX_STRIDE];
    dgfem_real traction[2][3 * DGFEM_MATRIX_STRIDE], adjoint[2][3 * DGFEM_MATRIX_STRIDE];
    dgfem_real rest[2 * 9 * DGFEM_VECTOR_STRIDE];
} dgfemi_face_terms;

/* The same of an element, for each entry of G. */
typedef struct dgfemi_element_terms {
    dgfem_real entry[9 * DGFEM_MATRIX_STRIDE];
    dgfem_real rest[27 * DGFEM_VECTOR_STRIDE];
} dgfemi_element_terms;

static void dgfemi_set_four(dgfem_vec3 v, dgfem_real *four) {
    four[0] = v.x, four[1] = v.y, four[2] = v.z, four[3] = 0;
}

/* k = held w^T, and its transpose, where only the component along `held` is kept. */
static void dgfemi_set_held(const dgfemi_warped_face *face, int s, dgfem_vec3 q, dgfem_real *k,
                            dgfem_real *transposed) {
    dgfem_vec3 row = dgfemi_held_row(face, s, q);
    for (int p = 0; p < 9; p++)
        transposed[4 * (p % 3) + p / 3] = k[4 * (p / 3) + p % 3] =
            dgfemi_axis(face->held, p / 3) * dgfemi_axis(row, p % 3);
}

/* Of the tractions of side s. */
static void dgfemi_set_tractions(const dgfemi_assembly *a, const dgfemi_warped_face *face, int s,
                                 dgfemi_face_terms *terms) {
    dgfem_real normal[4], q[3][4], lambda = face->lambda[s], mu = face->mu[s];
    dgfem_vec3 change[3];
    dgfemi_set_four(face->normal[s], normal);
    for (int d = 0; d < 3; d++)
        dgfemi_set_four(dgfemi_scale(a->scale, dgfemi_column(face->rotation[s], d)), q[d]);
    for (int d = 0; d < 3; d++) {
        dgfem_real *k = terms->traction[s] + d * DGFEM_MATRIX_STRIDE;
        dgfem_real *transposed = terms->adjoint[s] + d * DGFEM_MATRIX_STRIDE;
        if (face->form->normal_only) {
            dgfemi_set_held(face, s, dgfemi_vec3(q[d][0], q[d][1], q[d][2]), k, transposed);
        } else {
            a->kernels->set_elastic(lambda, mu, normal, q[d], k);
            a->kernels->set_elastic(lambda, mu, q[d], normal, transposed);
        }
    }
    if (!a->f0 || !a->body->desc.warp) return;
    dgfemi_rotated_rest(face->rotation[s], a->body->scale[face->form->element[s]] / a->scale, change);
    for (int j = 0; j < 3; j++)
        a->kernels->transform(terms->adjoint[s], 3, &change[j].x, terms->rest + (9 * s + 3 * j) * DGFEM_VECTOR_STRIDE);
}

static void dgfemi_set_terms(const dgfemi_assembly *a, const dgfemi_warped_face *face, dgfemi_face_terms *terms) {
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++) {
            terms->penalty[4 * p + q] = a->scale * face->penalty_stiff.m[p][q];
            terms->penalty[DGFEM_MATRIX_STRIDE + 4 * p + q] = a->scale * face->penalty_rest.m[p][q];
        }
    for (int s = 0; s < 2; s++)
        if (dgfemi_form_has_traction(face->form, s)) dgfemi_set_tractions(a, face, s, terms);
}

static dgfem_real *dgfemi_diagonal_block(const dgfem_matrix *matrix, int row) {
    return matrix->values + matrix->value_start[dgfemi_diagonal_index(matrix, row)];
}

/* The lower triangle of K_w of an element: with r_c the columns of R, the entry G_cd belongs to
   lambda r_c r_d^T + mu r_d r_c^T + mu (r_c.r_d) I. And f0. */
static void dgfemi_assemble_element(const dgfemi_assembly *a, int element, dgfemi_element_terms *terms) {
    const dgfem_body *body = a->body;
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_real *g = dgfemi_form_stiffness(body->forms, element), *parts[9];
    const dgfem_material *m = &body->material[element];
    dgfem_real lambda = a->scale * dgfemi_lambda(m), mu = a->scale * dgfemi_mu(m), r[3][4];
    dgfem_vec3 change[3], *f0 = a->f0 && body->desc.warp ? a->f0 + body->basis_start[element] : NULL;
    dgfemi_sums sums;
    int n = 3 * form->count;
    for (int c = 0; c < 3; c++) dgfemi_set_four(dgfemi_column(&a->rotation[element], c), r[c]);
    for (int c = 0; c < 9; c++)
        a->kernels->set_elastic(lambda, mu, r[c / 3], r[c % 3], terms->entry + c * DGFEM_MATRIX_STRIDE);
    memset(&sums, 0, sizeof sums);
    sums.a = g, sums.b[0] = terms->entry, sums.b[1] = terms->entry + 2 * DGFEM_MATRIX_STRIDE;
    sums.b[2] = terms->entry + 5 * DGFEM_MATRIX_STRIDE;
    sums.inner = 9, sums.rows = form->count - 1, sums.step = 9 * (form->count - 1);
    sums.out = dgfemi_diagonal_block(a->matrix, element) + 3 * n + 3, sums.stride = n, sums.room = n - 3;
    a->kernels->add_matrices(&sums);
    if (!f0) return;
    dgfemi_rotated_rest(&a->rotation[element], body->scale[element] / a->scale, change);
    for (int c = 0; c < 27; c++) /* the transpose of G_cd's matrix is that of G_dc */
        a->kernels->transform(terms->entry + (c % 3 * 3 + c / 3 % 3) * DGFEM_MATRIX_STRIDE, 1, &change[c / 9].x,
                              terms->rest + c * DGFEM_VECTOR_STRIDE);
    for (int i = 1; i < form->count; i++, g += sums.step) {
        for (int c = 0; c < 9; c++) parts[c] = g + 3 * c;
        a->kernels->add_vectors(parts, 9, terms->rest, &f0[i].x);
    }
}

/* Diagonal blocks are summed in their lower triangles. */
static void dgfemi_mirror_diagonal(const dgfem_matrix *matrix, int row) {
    dgfem_real *block = dgfemi_diagonal_block(matrix, row);
    int n = dgfemi_block_size(matrix, row);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) block[j * n + i] = block[i * n + j];
}

/* Rows of functions of side r, and columns of side s: 00, 10 or 11; of 00 and 11 the lower triangle. */
static dgfemi_sums dgfemi_face_sums(const dgfemi_warped_face *face, int r, int s, const dgfemi_face_terms *terms,
                                    dgfem_real *out) {
    const dgfemi_face_form *form = face->form;
    int first = r ? form->count[0] : 0, column = s ? form->count[0] : 0;
    dgfemi_sums sums;
    sums.a = dgfemi_face_pair(face, first, column);
    sums.b[0] = terms->penalty, sums.b[1] = terms->traction[s], sums.b[2] = terms->adjoint[r];
    sums.inner = face->terms, sums.rows = form->count[r], sums.count = r == s ? 0 : form->count[s];
    sums.step = first * face->terms, sums.growth = face->terms;
    sums.out = out, sums.stride = sums.room = 3 * form->count[s];
    return sums;
}

static void dgfemi_assemble_face_diagonal(const dgfemi_assembly *a, const dgfemi_warped_face *face, int s,
                                          const dgfemi_face_terms *terms) {
    dgfem_real *out = dgfemi_diagonal_block(a->matrix, face->form->element[s]);
    dgfemi_sums sums = dgfemi_face_sums(face, s, s, terms, out);
    a->kernels->add_matrices(&sums);
}

/* The block that couples both sides: rows of side 1, or where its element comes first, of side 0. */
static void dgfemi_assemble_face_coupling(const dgfemi_assembly *a, const dgfemi_warped_face *face,
                                          const dgfemi_face_terms *terms) {
    const dgfemi_face_form *form = face->form;
    int below = form->element[1] > form->element[0], n = 3 * form->count[0], m = 3 * form->count[1];
    dgfem_real *out = dgfem_matrix_block(a->matrix, form->element[below], form->element[!below]);
    dgfem_real block[9 * DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    dgfemi_sums sums = dgfemi_face_sums(face, 1, 0, terms, below ? out : block);
    if (!below) memset(block, 0, (size_t)(n * m) * sizeof *block);
    a->kernels->add_matrices(&sums);
    for (int j = 0; j < n && !below; j++)
        for (int i = 0; i < m; i++) out[j * m + i] += block[i * n + j];
}

/* f0 of the consistency terms of both sides, for the rows of side r: linear in the entries of q_ij, j = 1, 2, 3. */
static void dgfemi_face_rest_force(const dgfemi_assembly *a, const dgfemi_warped_face *face, int r,
                                   const dgfem_real *rest) {
    const dgfemi_face_form *form = face->form;
    dgfem_vec3 *f0 = a->f0 + a->body->basis_start[form->element[r]];
    const dgfem_real *columns[6], *parts[6];
    int count = form->element[1] == DGFEM_NONE ? 3 : 6, first = r ? form->count[0] : 0, column[6];
    for (int c = 0; c < count; c++) {
        column[c] = c < 3 ? 1 + c : form->count[0] + c - 2;
        columns[c] = dgfemi_face_pair(face, column[c], 0) + 5;
    }
    for (int i = 0; i < form->count[r]; i++) {
        const dgfem_real *row = dgfemi_face_pair(face, first + i, 0) + 2;
        for (int c = 0; c < count; c++)
            parts[c] = first + i >= column[c] ? row + 8 * column[c] : columns[c] + 8 * (first + i);
        a->kernels->add_vectors(parts, count, rest, &f0[i].x);
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

/* What a face adds to the rows of the elements first <= e < last. */
static void dgfemi_assemble_face(const dgfemi_assembly *a, const dgfemi_face_form *form, int first, int last,
                                 dgfemi_face_terms *terms) {
    dgfemi_warped_face face;
    int with_rest = a->f0 && a->body->desc.warp && form->consistent, row = form->element[0];
    dgfemi_warp_face(a->body, form, a->rotation, &face);
    dgfemi_set_terms(a, &face, terms);
    for (int s = 0; s < 2; s++) {
        int e = form->element[s];
        if (e < first || e >= last) continue;
        dgfemi_assemble_face_diagonal(a, &face, s, terms);
        if (with_rest) dgfemi_face_rest_force(a, &face, s, terms->rest);
    }
    if (form->element[1] == DGFEM_NONE) {
        if (a->f0) dgfemi_held_force(a->body, &face, a->factor, a->f0);
        return;
    }
    if (form->element[1] > row) row = form->element[1];
    if (row >= first && row < last) dgfemi_assemble_face_coupling(a, &face, terms);
}

static void dgfemi_clear_row(const dgfemi_assembly *a, int row) {
    const size_t *start = a->matrix->value_start;
    size_t first = start[a->matrix->row_start[row]], last = start[a->matrix->row_start[row + 1]];
    int basis = a->body->basis_start[row];
    memset(a->matrix->values + first, 0, (last - first) * sizeof(dgfem_real));
    if (a->f0) memset(a->f0 + basis, 0, (size_t)(a->body->basis_start[row + 1] - basis) * sizeof *a->f0);
}

/* The rows of the elements first <= e < last. */
static void dgfemi_assemble_rows(const dgfemi_assembly *a, int first, int last, int late) {
    const dgfem_forms *forms = a->body->forms;
    dgfemi_face_terms terms;
    dgfemi_element_terms element;
    memset(&terms, 0, sizeof terms);
    memset(&element, 0, sizeof element);
    for (int e = first; e < last; e++) {
        dgfemi_clear_row(a, e);
        dgfemi_assemble_element(a, e, &element);
        for (int f = forms->elements[e].face; f != DGFEM_NONE; f = forms->faces[f].next[0])
            dgfemi_assemble_face(a, &forms->faces[f], first, last, &terms);
    }
    for (int f = late; f != DGFEM_NONE; f = forms->faces[f].next[1])
        dgfemi_assemble_face(a, &forms->faces[f], first, last, &terms);
    for (int e = first; e < last; e++) dgfemi_mirror_diagonal(a->matrix, e);
}

static void dgfemi_assemble_chunks(void *context, int first, int last) {
    const dgfemi_assembly *a = (const dgfemi_assembly *)context;
    const int *row = a->matrix->sharing->row;
    for (int c = first; c < last; c++) dgfemi_assemble_rows(a, row[c], row[c + 1], a->late[c]);
}

/* The faces of each element, ascending, without those of later ones. */
static void dgfemi_list_faces(const dgfem_body *body) {
    const dgfem_forms *forms = body->forms;
    for (int e = 0; e < body->mesh->element_count; e++) forms->elements[e].face = DGFEM_NONE;
    for (int f = forms->face_count - 1; f >= 0; f--) {
        dgfemi_face_form *face = &forms->faces[f];
        int row = face->element[1] > face->element[0] ? face->element[1] : face->element[0];
        face->next[0] = forms->elements[row].face;
        forms->elements[row].face = f;
    }
}

/* Those between two chunks, for the earlier one, in the order of the rows that they come with. */
static void dgfemi_list_late_faces(dgfemi_assembly *a) {
    const dgfem_forms *forms = a->body->forms;
    const int *row = a->matrix->sharing->row;
    int *end[DGFEM_MOST_CHUNKS]; /* where the number of the next one goes */
    for (int c = 0; c < a->matrix->sharing->chunk_count; c++) {
        a->late[c] = DGFEM_NONE;
        end[c] = &a->late[c];
        for (int e = row[c]; e < row[c + 1]; e++)
            for (int f = forms->elements[e].face; f != DGFEM_NONE; f = forms->faces[f].next[0]) {
                dgfemi_face_form *face = &forms->faces[f];
                int other = face->element[face->element[0] == e], earlier = c;
                if (other == DGFEM_NONE || other >= row[c]) continue;
                while (other < row[earlier]) earlier--;
                face->next[1] = DGFEM_NONE;
                *end[earlier] = f;
                end[earlier] = &face->next[1];
            }
    }
}

/* matrix = scale * K_w; f0 (may be NULL) = warping's force plus `factor` times that of prescribed displacements. */
static void dgfemi_assemble_stiffness(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_real scale,
                                      dgfem_real factor, dgfem_matrix *matrix, dgfem_vec3 *f0) {
    dgfemi_assembly a;
    memset(&a, 0, sizeof a);
    a.body = body, a.rotation = rotation, a.scale = scale, a.factor = factor, a.matrix = matrix, a.f0 = f0;
    a.kernels = dgfemi_kernels_choose(DGFEM_SIMD_AUTO);
    dgfemi_list_faces(body);
    if (!matrix->sharing) {
        dgfemi_assemble_rows(&a, 0, matrix->block_count, DGFEM_NONE);
        return;
    }
    dgfemi_list_late_faces(&a);
    dgfemi_parallel_for(&matrix->hooks, matrix->sharing->chunk_count, 1, dgfemi_assemble_chunks, &a);
}

typedef struct dgfemi_mass_assembly {
    const dgfem_body *body;
    dgfem_real factor;
} dgfemi_mass_assembly;

static void dgfemi_assemble_mass_rows(void *context, const dgfem_matrix *matrix, int first, int last,
                                      size_t diagonal) {
    const dgfemi_mass_assembly *assembly = (const dgfemi_mass_assembly *)context;
    const dgfem_body *body = assembly->body;
    (void)diagonal;
    for (int e = first; e < last; e++) {
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        dgfem_real *out = dgfemi_diagonal_block(matrix, e), factor = assembly->factor * body->material[e].density;
        int n = body->forms->elements[e].count;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int a = 0; a < 3; a++) out[(3 * i + a) * 3 * n + 3 * j + a] += factor * mass[i * n + j];
    }
}

/* Adds s * (mass matrix) to the diagonal blocks. */
static void dgfemi_assemble_mass(const dgfem_body *body, dgfem_real s, dgfem_matrix *matrix) {
    dgfemi_mass_assembly assembly;
    assembly.body = body, assembly.factor = s;
    dgfemi_for_rows(matrix, dgfemi_assemble_mass_rows, &assembly);
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
