#pragma once
#include "solve.c"
/* How large the penalty must be: a bound per element that guarantees a positive definite stiffness for any rotations of
   the elements, and a search by factorization.

   The consistency terms of element K are bounded by its strain energy through
     theta_K = max over v of  sum over faces f of  w_f / (g_f p^2) int_f (sigma n) . (N^T C N)^-1 (sigma n)
                              / int_K sigma : eps,
   where N^T C N = mu I + (lambda + mu) n n^T, w_f = 1/2 between elements and 1 on held faces. eta > theta_K in all
   elements suffices: |R sigma n| = |sigma n|, so rotations change nothing. theta_K is the largest eigenvalue of a
   matrix pair on the complement of rigid motions, where both vanish. */

#define DGFEM_MAX_UNKNOWNS (3 * DGFEM_MAX_BASIS)

/* Coefficients of the traction sigma(N_j e_b) n in face monomials of degree below p: out[k] is the 3x3 matrix of
   monomial k (rows: components of the traction, columns: b). */
static void dgfemi_traction_coefficients(const dgfemi_face_frame *frame, int j, dgfem_vec3 n, dgfem_real lambda,
                                         dgfem_real mu, dgfem_mat3 *out) {
    memset(out, 0, (size_t)frame->lower_count * sizeof *out);
    for (int k = 0; k < frame->lower_count; k++) {
        const dgfem_real(*g)[DGFEM_MAX_LOWER_BASIS] = frame->gradient[j];
        dgfemi_add_elastic(lambda, mu, n, dgfemi_vec3(g[0][k], g[1][k], g[2][k]), &out[k]);
    }
}

/* a += s int_f T_i^T W T_j for all functions of the element, which begin with `first` in the frame. */
static void dgfemi_add_traction_energy(const dgfemi_face_frame *frame, int first, int count, dgfem_vec3 n,
                                       dgfem_real lambda, dgfem_real mu, dgfem_real s, dgfem_real *a) {
    dgfem_mat3 t[DGFEM_MAX_BASIS][DGFEM_MAX_LOWER_BASIS], w;
    int lower_count = frame->lower_count;
    memset(&w, 0, sizeof w);
    w.m[0][0] = w.m[1][1] = w.m[2][2] = s / mu;
    dgfemi_add_outer(&w, s / (lambda + 2 * mu) - s / mu, n, n);
    for (int j = 0; j < count; j++) dgfemi_traction_coefficients(frame, first + j, n, lambda, mu, t[j]);
    for (int j = 1; j < count; j++) {
        dgfem_mat3 moment[DGFEM_MAX_LOWER_BASIS]; /* int m_l W T_j */
        for (int l = 0; l < lower_count; l++) {
            memset(&moment[l], 0, sizeof moment[l]);
            for (int k = 0; k < lower_count; k++) {
                dgfem_real m = frame->moments[dgfemi_product_index(k, l)];
                for (int p = 0; p < 9; p++) moment[l].m[p / 3][p % 3] += m * t[j][k].m[p / 3][p % 3];
            }
            moment[l] = dgfemi_multiply3(&w, &moment[l]);
        }
        for (int i = 1; i < count; i++)
            for (int l = 0; l < lower_count; l++) {
                dgfem_mat3 transposed = dgfemi_transposed(&t[i][l]);
                dgfem_mat3 product = dgfemi_multiply3(&transposed, &moment[l]);
                dgfemi_add_block(a + 3 * (3 * i * count + j), 3 * count, product.m[0]);
            }
    }
}

/* Both matrices of the pair; b is made definite by adding the rigid motions. */
static void dgfemi_stability_pair(const dgfem_body *body, int element, dgfem_real *a, dgfem_real *b) {
    const dgfem_forms *forms = body->forms;
    int n = forms->elements[element].count, size = 3 * n;
    dgfem_real lambda = dgfemi_lambda(&body->material[element]), mu = dgfemi_mu(&body->material[element]);
    const dgfem_real *g = dgfemi_form_stiffness(forms, element);
    memset(a, 0, (size_t)size * (size_t)size * sizeof *a);
    memset(b, 0, (size_t)size * (size_t)size * sizeof *b);
    for (int i = 1; i < n; i++)
        for (int j = 1; j < n; j++, g += 9) {
            dgfem_mat3 k;
            for (int c = 0; c < 9; c++)
                k.m[c / 3][c % 3] = lambda * g[c] + mu * g[3 * (c % 3) + c / 3] +
                                    (c % 4 == 0 ? mu * (g[0] + g[4] + g[8]) : 0);
            dgfemi_add_block(b + 3 * (i * size + j), size, k.m[0]);
        }
    dgfem_real scale = b[(3 + 0) * size + 3] + b[(3 + 1) * size + 4]; /* of the linear functions */
    for (int k = 0; k < 3; k++) {
        int p = (k + 1) % 3, q = (k + 2) % 3, u = 3 * (1 + p) + q, v = 3 * (1 + q) + p; /* turning about axis k */
        b[k * size + k] += scale;
        b[u * size + u] += scale, b[v * size + v] += scale;
        b[u * size + v] -= scale, b[v * size + u] -= scale;
    }
    for (int f = 0; f < forms->face_count; f++) {
        dgfemi_face_form form = forms->faces[f];
        if (form.element[0] != element && form.element[1] != element) continue;
        dgfemi_face_frame frame;
        int first = form.element[0] == element ? 0 : form.count[0];
        dgfem_real weight = form.weight * body->desc.eta / form.eta_stiff;
        dgfemi_face_frame_set(body, &form, &frame);
        dgfemi_add_traction_energy(&frame, first, n, body->mesh->faces[form.face].normal, lambda, mu, weight, a);
    }
}

/* Largest eigenvalue of L^-1 A L^-T by power iteration: the Rayleigh quotient converges twice as fast as the vector. */
static dgfem_real dgfemi_largest_eigenvalue(const dgfem_real *a, const dgfem_real *l, int size) {
    enum { ITERATIONS = 2000 };
    dgfem_real x[DGFEM_MAX_UNKNOWNS], y[DGFEM_MAX_UNKNOWNS], value = 0;
    for (int i = 0; i < size; i++) x[i] = 1 + DGFEM_R(0.5) * dgfemi_sqrt((dgfem_real)((7 * i * i + 3) % 11));
    for (int iteration = 0; iteration < ITERATIONS; iteration++) {
        dgfem_real z[DGFEM_MAX_UNKNOWNS], last = value;
        dgfem_real norm = (dgfem_real)sqrt(dgfemi_vector_dot(size, x, x));
        if (!(norm > 0)) return 0;
        for (int i = 0; i < size; i++) z[i] = x[i] = x[i] / norm;
        for (int i = size - 1; i >= 0; i--) { /* L^-T */
            for (int k = i + 1; k < size; k++) z[i] -= l[k * size + i] * z[k];
            z[i] /= l[i * size + i];
        }
        for (int i = 0; i < size; i++) {
            y[i] = 0;
            for (int k = 0; k < size; k++) y[i] += a[i * size + k] * z[k];
        }
        value = 0;
        for (int i = 0; i < size; i++) { /* L^-1 */
            for (int k = 0; k < i; k++) y[i] -= l[i * size + k] * y[k];
            y[i] /= l[i * size + i];
            value += x[i] * y[i];
        }
        memcpy(x, y, (size_t)size * sizeof *x);
        if (iteration > 20 && dgfemi_abs(value - last) <= DGFEM_R(1e-7) * value) break;
    }
    return value;
}

DGFEM_API dgfem_status dgfem_body_stability_bound(const dgfem_body *body, int element, dgfem_real *theta) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_out(&body->hooks, theta, "stability_bound");
    if (status) return status;
    if (element < 0 || element >= body->mesh->element_count)
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "element %d, expected 0..%d", element,
                           body->mesh->element_count - 1);
    int size = 3 * body->forms->elements[element].count;
    size_t square = (size_t)size * (size_t)size;
    dgfem_real *a = (dgfem_real *)dgfemi_allocate(&body->hooks, 2 * square, sizeof *a), *b = a + square;
    if (!a) return dgfemi_fail_memory(&body->hooks);
    dgfemi_stability_pair(body, element, a, b);
    if (dgfemi_cholesky_dense(b, size)) *theta = dgfemi_largest_eigenvalue(a, b, size);
    else
        status =
            dgfemi_fail(&body->hooks, DGFEM_ERROR_DEGENERATE, "element %d: its strain energy is not definite", element);
    dgfemi_free(&body->hooks, a);
    return status;
}

/* ---- search ---- */

static void dgfemi_set_eta(dgfem_body *body, dgfem_real eta) {
    for (int f = 0; f < body->forms->face_count; f++) body->forms->faces[f].eta_stiff *= eta / body->desc.eta;
    body->desc.eta = eta;
}

DGFEM_API dgfem_status dgfem_body_set_eta(dgfem_body *body, dgfem_real eta) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_positive(&body->hooks, eta, "eta");
    if (!status) dgfemi_set_eta(body, eta);
    return status;
}

/* Factors the unrotated stiffness of the body, held as it is; one that can still move as a rigid body is held by a
   trace of its mass. */
static dgfem_status dgfemi_try_eta(dgfem_body *body, int is_free, dgfem_cholesky *cholesky, dgfem_cholesky_info *info) {
    const dgfem_real trace = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9); /* of a typical stiffness */
    dgfem_mat3 *rotation = dgfemi_next_rotation(body);
    dgfem_vec3 *rhs = dgfemi_work(body, DGFEMI_WORK_RHS);
    for (int e = 0; e < body->mesh->element_count; e++) rotation[e] = dgfemi_identity();
    dgfemi_assemble_stiffness(body, rotation, 1, 0, body->matrix, NULL);
    if (is_free) {
        dgfem_real r = body->scale[0];
        dgfemi_assemble_mass(body, trace * body->material[0].young / (body->material[0].density * r * r), body->matrix);
    }
    memset(rhs, 0, (size_t)body->basis_count * sizeof *rhs);
    dgfemi_assemble_pins(body, 1, 0, 0, body->matrix, rhs);
    dgfemi_hold_elements(body, 1, 0, body->matrix, rhs);
    return dgfem_cholesky_factor(cholesky, body->matrix, info);
}

DGFEM_API dgfem_status dgfem_body_find_eta(dgfem_body *body, dgfem_real *eta) {
    enum { MAX_DOUBLINGS = 10 };
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_out(&body->hooks, eta, "find_eta");
    if (status) return status;
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = body->cholesky;
    dgfem_cholesky_info info;
    int free_element;
    status = dgfemi_find_free_piece(body, &free_element);
    dgfem_real first = body->desc.eta;
    desc.hooks = body->hooks;
    if (!status && !cholesky) status = dgfem_cholesky_create(body->matrix, &desc, &cholesky);
    if (status) return status;
    if (body->step_solver) body->step_solver->is_factored = 0;
    cholesky->hooks.log = NULL; /* the failure of a trial is no error */
    for (int doublings = 0;; doublings++) {
        status = dgfemi_try_eta(body, free_element != DGFEM_NONE, cholesky, &info);
        if (status != DGFEM_ERROR_NOT_POSITIVE_DEFINITE || doublings == MAX_DOUBLINGS) break;
        dgfemi_set_eta(body, 2 * body->desc.eta);
    }
    cholesky->hooks.log = body->hooks.log;
    if (cholesky != body->cholesky) dgfem_cholesky_destroy(cholesky);
    if (!status) {
        *eta = body->desc.eta;
        return DGFEM_OK;
    }
    status = dgfemi_fail(&body->hooks, status, "find_eta: pivot of element %d with eta %g", info.failed_block,
                         (double)body->desc.eta);
    dgfemi_set_eta(body, first);
    return status;
}
