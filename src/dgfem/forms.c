#pragma once
#include "basis.c"
#include "mesh.c"
/* The integrals behind the weak form, from moments alone, in the unrotated material. They are kept in the smallest form
   from which the rotated 3x3 blocks of warp.c follow:

     element   M_ij = int N_i N_j,   G_ij = int grad N_i grad N_j^T (3x3),   l_i = int N_i
     face      J = [N_a, -N_b] over the functions of both sides; for a held face side b is a ghost that carries the
               prescribed displacement as a polynomial about the face's centre
               P_ij  = int P[J_i] P[J_j]          the stiffly penalised part of the jump
               Q_ij  = int J_i J_j - P_ij         the rest
               q^s_ij = int J_i grad N^s_j        (vector) for both sides s: all that a traction needs, because
               traction_j(a,b) = lambda n_a q_b + mu q_a n_b + mu (n.q) delta_ab

   Functions of degree zero have no gradient, so j >= 1 in G and q. */

/* Different sizes of chunks, for degrees 1 to 3: elements have 3, held faces 3, glued faces 9 (one per pair of degrees,
   in either order). The flux decides for the whole body whether faces have tractions. */
enum { DGFEM_CHUNK_SIZES = 16 };

typedef struct dgfemi_chunks {
    size_t *data;
    int count, capacity;
} dgfemi_chunks;

/* The integrals of all elements and faces live in one array, each in a chunk of it. As there are few sizes of chunks, a
   chunk that is given back is kept for the next of its size: the array only grows. */
typedef struct dgfemi_chunk_bin {
    size_t size;
    dgfemi_chunks free; /* offsets of the chunks given back */
} dgfemi_chunk_bin;

typedef struct dgfemi_element_form {
    int count;   /* basis functions */
    int face;    /* first in a list of assembly, see warp.c */
    size_t data; /* chunk: mass [count^2], load [count], stiffness [(count - 1)^2] 3x3 matrices, row-major */
} dgfemi_element_form;

typedef struct dgfemi_face_form {
    int face;
    int element[2]; /* element[1] is DGFEM_NONE on a held face */
    int count[2];   /* functions of each side; count[1] of the ghost on a held face */
    size_t data;    /* chunk: P_ij, Q_ij and, where there are tractions, q_ij and q_ji (of the sides of j and i), by
                              rows i of the lower triangle, i counting the functions of both sides; ghost [count[1]]
                              vectors on a held face */
    dgfem_real eta_stiff; /* eta0 p^2 g_f */
    dgfem_real eta_rest;  /* eta_r p^2 g_f */
    dgfem_real weight;    /* of the average: 1/2, on a held face 1 */
    int consistent;       /* 1: IP, 0: BZ, whose forms have no tractions */
    int normal_only;      /* held face: 1: only the component along the rest normal is held */
    int condition;        /* held face: id of the condition that holds it, else DGFEM_NONE */
    int next[2];          /* in the lists of assembly, see warp.c */
} dgfemi_face_form;

struct dgfem_forms {
    dgfemi_element_form *elements;
    dgfemi_face_form *faces;
    int face_count, face_capacity;
    dgfem_real *data;
    size_t data_count, data_capacity;
    dgfemi_chunk_bin bins[DGFEM_CHUNK_SIZES];
    int bin_count;
};

static dgfem_real dgfemi_mu(const dgfem_material *m) { return m->young / (2 * (1 + m->poisson)); }
static dgfem_real dgfemi_lambda(const dgfem_material *m) {
    return m->young * m->poisson / ((1 + m->poisson) * (1 - 2 * m->poisson));
}

/* ---- where things are in a chunk ---- */

static size_t dgfemi_element_form_size(int count) {
    size_t n = (size_t)count;
    return n * n + n + 9 * (n - 1) * (n - 1);
}
static dgfem_real *dgfemi_form_mass(const dgfem_forms *forms, int element) {
    return forms->data + forms->elements[element].data;
}
static dgfem_real *dgfemi_form_load(const dgfem_forms *forms, int element) {
    size_t n = (size_t)forms->elements[element].count;
    return dgfemi_form_mass(forms, element) + n * n;
}
static dgfem_real *dgfemi_form_stiffness(const dgfem_forms *forms, int element) {
    return dgfemi_form_load(forms, element) + forms->elements[element].count;
}

static size_t dgfemi_form_sides(const dgfemi_face_form *form) { return (size_t)(form->count[0] + form->count[1]); }
static int dgfemi_form_has_traction(const dgfemi_face_form *form, int side) {
    return form->consistent && form->element[side] != DGFEM_NONE;
}
/* Integrals of each pair of functions. */
static int dgfemi_form_terms(const dgfemi_face_form *form) { return form->consistent ? 8 : 2; }
static size_t dgfemi_form_pairs_size(const dgfemi_face_form *form) {
    size_t sides = dgfemi_form_sides(form);
    return (size_t)dgfemi_form_terms(form) * (sides * (sides + 1) / 2);
}
static size_t dgfemi_face_form_size(const dgfemi_face_form *form) {
    return dgfemi_form_pairs_size(form) + (form->element[1] == DGFEM_NONE ? 3 * (size_t)form->count[1] : 0);
}
/* Those of functions i >= j. */
static dgfem_real *dgfemi_form_pair(const dgfem_forms *forms, const dgfemi_face_form *form, int i, int j) {
    return forms->data + form->data + dgfemi_form_terms(form) * (i * (i + 1) / 2 + j);
}
static dgfem_vec3 *dgfemi_form_ghost(const dgfem_forms *forms, const dgfemi_face_form *form) {
    return (dgfem_vec3 *)(void *)(forms->data + form->data + dgfemi_form_pairs_size(form));
}

/* ---- the pool ---- */

static dgfemi_chunk_bin *dgfemi_forms_bin(dgfem_forms *forms, size_t size) {
    for (int i = 0; i < forms->bin_count; i++)
        if (forms->bins[i].size == size) return &forms->bins[i];
    DGFEM_ASSERT(forms->bin_count < DGFEM_CHUNK_SIZES);
    forms->bins[forms->bin_count].size = size;
    return &forms->bins[forms->bin_count++];
}

/* A chunk of `size` numbers; its offset goes to *offset. 0 when out of memory. */
static int dgfemi_forms_take(dgfem_forms *forms, const dgfem_hooks *hooks, size_t size, size_t *offset) {
    dgfemi_chunk_bin *bin = dgfemi_forms_bin(forms, size);
    if (bin->free.count > 0) {
        *offset = bin->free.data[--bin->free.count];
        return 1;
    }
    if (forms->data_capacity - forms->data_count < size) {
        size_t wanted = forms->data_capacity + forms->data_capacity / 2;
        if (wanted < forms->data_count + size) wanted = forms->data_count + size;
        dgfem_real *grown = (dgfem_real *)dgfemi_reallocate(hooks, forms->data, wanted, sizeof(dgfem_real));
        if (!grown) return 0;
        forms->data = grown;
        forms->data_capacity = wanted;
    }
    *offset = forms->data_count;
    forms->data_count += size;
    return 1;
}

/* Gives a chunk back. Where the list of free ones cannot grow the chunk is lost until the forms are destroyed. */
static void dgfemi_forms_give(dgfem_forms *forms, const dgfem_hooks *hooks, size_t size, size_t offset) {
    dgfemi_chunks *chunks = &dgfemi_forms_bin(forms, size)->free;
    if (chunks->count == chunks->capacity) {
        void *grown = dgfemi_grow(hooks, chunks->data, &chunks->capacity, chunks->count + 1, sizeof(size_t));
        if (!grown) return;
        chunks->data = (size_t *)grown;
    }
    chunks->data[chunks->count++] = offset;
}

static void dgfemi_forms_destroy(dgfem_forms *forms, const dgfem_hooks *hooks) {
    if (!forms) return;
    for (int i = 0; i < forms->bin_count; i++) dgfemi_free(hooks, forms->bins[i].free.data);
    dgfemi_free(hooks, forms->elements);
    dgfemi_free(hooks, forms->faces);
    dgfemi_free(hooks, forms->data);
    dgfemi_free(hooks, forms);
}

/* ---- moments ---- */

#define DGFEM_MAX_MOMENTS 84 /* dgfem_monomial_count(DGFEM_MAX_MOMENT_DEGREE) */

static void dgfemi_moments_loops(const dgfem_mesh *mesh, const dgfem_face *face, int reverse, dgfemi_moments *moments) {
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        dgfemi_moments_loop(moments, mesh->vertices, mesh->loop_vertices + mesh->loops[l].start, mesh->loops[l].count,
                            reverse);
}

/* out[i] = integral of monomial i of (x - centre)/scale over the element. */
static void dgfemi_element_moments(const dgfem_mesh *mesh, int element, int degree, dgfem_vec3 centre, dgfem_real scale,
                                   dgfem_real *out) {
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_moments moments;
    dgfemi_moments_begin_volume(&moments, degree, centre, scale);
    for (int k = 0; k < e->face_count; k++) {
        int face = mesh->element_faces[e->face_start + k];
        dgfemi_moments_loops(mesh, &mesh->faces[face], dgfemi_mesh_sign(mesh, element, face) < 0, &moments);
    }
    dgfemi_moments_end(&moments, out);
}

/* The same over a face. */
static void dgfemi_mesh_face_moments(const dgfem_mesh *mesh, int face, int degree, dgfem_vec3 centre, dgfem_real scale,
                                     dgfem_real *out) {
    dgfemi_moments moments;
    dgfemi_moments_begin_face(&moments, degree, centre, scale, mesh->faces[face].normal);
    dgfemi_moments_loops(mesh, &mesh->faces[face], 0, &moments);
    dgfemi_moments_end(&moments, out);
}

/* ---- elements ---- */

/* G_ij[a][b] = int d_a N_i d_b N_j: the product of two derivatives is one monomial again, so each entry is a moment. */
static void dgfemi_element_stiffness(int count, dgfem_real scale, const dgfem_real *moments, dgfem_real *out) {
    dgfem_real inverse = 1 / (scale * scale);
    for (int i = 1; i < count; i++)
        for (int j = 1; j < count; j++)
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++, out++) {
                    int di = dgfemi_derivative_index(i, a), dj = dgfemi_derivative_index(j, b);
                    *out = 0;
                    if (di == DGFEM_NONE || dj == DGFEM_NONE) continue;
                    dgfem_real factor = (dgfem_real)(dgfemi_exponents[i][a] * dgfemi_exponents[j][b]) * inverse;
                    *out = factor * moments[dgfemi_product_index(di, dj)];
                }
}

/* The integrals of one element. 0 when out of memory. */
static int dgfemi_forms_set_element(const dgfem_body *body, dgfem_forms *forms, int element) {
    dgfemi_element_form *form = &forms->elements[element];
    int degree = body->degree[element], n = dgfem_monomial_count(degree);
    dgfem_real moments[DGFEM_MAX_MOMENTS];
    form->count = n;
    if (!dgfemi_forms_take(forms, &body->hooks, dgfemi_element_form_size(n), &form->data)) return 0;
    dgfemi_element_moments(body->mesh, element, 2 * degree, body->origin[element], body->scale[element], moments);
    dgfem_real *mass = dgfemi_form_mass(forms, element);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) mass[i * n + j] = moments[dgfemi_product_index(i, j)];
    memcpy(dgfemi_form_load(forms, element), moments, (size_t)n * sizeof(dgfem_real));
    dgfemi_element_stiffness(n, body->scale[element], moments, dgfemi_form_stiffness(forms, element));
    return 1;
}

/* ---- faces ---- */

/* Total area of the element's faces in the plane of `face` with the same outward normal. The penalty is scaled by this
   patch, not by the face, so that dividing a face changes nothing. On the boundary, a smooth surface in triangles is
   one patch too: its faces count by how far they look the same way, or the bound on eta would grow with their number.
   */
static dgfem_real dgfemi_patch_area(const dgfem_mesh *mesh, int element, int face) {
    const dgfem_real tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    const dgfem_element *e = &mesh->elements[element];
    const dgfem_face *f = &mesh->faces[face];
    dgfem_real area = 0, sign = (dgfem_real)dgfemi_mesh_sign(mesh, element, face);
    for (int k = 0; k < e->face_count; k++) {
        int other = mesh->element_faces[e->face_start + k];
        const dgfem_face *g = &mesh->faces[other];
        dgfem_real same = sign * (dgfem_real)dgfemi_mesh_sign(mesh, element, other);
        dgfem_real turn = same * dgfemi_dot(f->normal, g->normal);
        if (f->element[1] == DGFEM_NONE) {
            if (g->element[1] == DGFEM_NONE && turn > 0) area += turn * turn * g->area;
            continue;
        }
        if (other != face) {
            if (!(turn > 1 - tolerance)) continue;
            if (dgfemi_abs(dgfemi_dot(f->normal, dgfemi_sub(g->centre, f->centre))) > tolerance * e->radius) continue;
        }
        area += g->area;
    }
    return area;
}

#define DGFEM_MAX_PLANE_BASIS 10 /* in-plane monomials up to DGFEM_MAX_DEGREE */
#define DGFEM_MAX_LOWER_BASIS 10 /* dgfem_monomial_count(DGFEM_MAX_DEGREE - 1) */

/* Everything about one face in monomials about its own centre, while its integrals are computed. */
typedef struct dgfemi_face_frame {
    int degree;      /* the larger of both sides */
    int count;       /* monomials up to degree, */
    int lower_count; /* and up to degree - 1 */
    dgfem_vec3 centre;
    dgfem_real scale;
    dgfem_vec3 axis[2]; /* in-plane principal axes, divided by the scaled radius of gyration along each */
    dgfem_real moments[DGFEM_MAX_MOMENTS];                      /* scaled, up to 2 * degree */
    int sides;                                                  /* functions of both sides */
    dgfem_real jump[2 * DGFEM_MAX_BASIS][DGFEM_MAX_BASIS];      /* J_i in face monomials */
    dgfem_real jump_gram[2 * DGFEM_MAX_BASIS][DGFEM_MAX_BASIS]; /* int J_i m_k */
    dgfem_real gradient[2 * DGFEM_MAX_BASIS][3][DGFEM_MAX_LOWER_BASIS]; /* of N_i in monomials up to degree - 1 */
} dgfemi_face_frame;

static dgfem_real dgfemi_face_radius(const dgfem_mesh *mesh, const dgfem_face *face) {
    dgfem_real largest = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int k = 0; k < mesh->loops[l].count; k++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + k]];
            largest = dgfemi_max(largest, dgfemi_distance(p, face->centre));
        }
    return largest;
}

/* The face's principal axes, each divided by the radius of gyration along it, from its moments up to degree 2: they
   make polynomials on a thin face well conditioned. */
static void dgfemi_face_axes(const dgfem_real *m, dgfem_vec3 normal, dgfem_vec3 axis[2]) {
    dgfem_mat3 inertia, vectors;
    dgfem_real values[3], area = m[0];
    inertia.m[0][0] = m[4], inertia.m[1][1] = m[7], inertia.m[2][2] = m[9];
    inertia.m[0][1] = inertia.m[1][0] = m[5];
    inertia.m[0][2] = inertia.m[2][0] = m[6];
    inertia.m[1][2] = inertia.m[2][1] = m[8];
    dgfem_eigen_symmetric(inertia, values, &vectors);
    axis[0] = dgfemi_column(&vectors, 2);
    axis[0] = dgfemi_normalized(dgfemi_add_scaled(axis[0], -dgfemi_dot(axis[0], normal), normal));
    axis[1] = dgfemi_cross(normal, axis[0]);
    for (int k = 0; k < 2; k++) {
        dgfem_real gyration = dgfemi_sqrt(dgfemi_max(values[2 - k], 0) / area);
        if (gyration > DGFEM_EPSILON) axis[k] = dgfemi_scale(1 / gyration, axis[k]);
    }
}

static void dgfemi_face_side(dgfemi_face_frame *frame, int first, int degree, dgfem_vec3 origin, dgfem_real scale,
                             dgfem_real sign) {
    dgfem_real shift[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    int n = dgfem_monomial_count(degree);
    dgfemi_basis_shift(degree, origin, scale, frame->centre, frame->scale, shift);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < frame->count; k++) frame->jump[first + i][k] = k < n ? sign * shift[i * n + k] : 0;
}

/* Each monomial is the derivative of one other along each axis. */
static void dgfemi_face_gradients(dgfemi_face_frame *frame, int first, int count, dgfem_real sign) {
    for (int i = first; i < first + count; i++)
        for (int k = 1; k < frame->count; k++)
            for (int axis = 0; axis < 3; axis++) {
                int lower = dgfemi_derivative_index(k, axis);
                if (lower == DGFEM_NONE) continue;
                dgfem_real factor = sign * (dgfem_real)dgfemi_exponents[k][axis] / frame->scale;
                frame->gradient[i][axis][lower] = factor * frame->jump[i][k];
            }
}

static void dgfemi_face_frame_set(const dgfem_body *body, const dgfemi_face_form *form, dgfemi_face_frame *frame) {
    const dgfem_face *face = &body->mesh->faces[form->face];
    int a = form->element[0], b = form->element[1];
    frame->degree = body->degree[a];
    if (b != DGFEM_NONE && body->degree[b] > frame->degree) frame->degree = body->degree[b];
    frame->count = dgfem_monomial_count(frame->degree);
    frame->lower_count = dgfem_monomial_count(frame->degree - 1);
    frame->sides = form->count[0] + form->count[1];
    frame->centre = face->centre;
    frame->scale = dgfemi_face_radius(body->mesh, face);
    dgfemi_mesh_face_moments(body->mesh, form->face, 2 * frame->degree, frame->centre, frame->scale, frame->moments);
    dgfemi_face_axes(frame->moments, face->normal, frame->axis);
    dgfemi_face_side(frame, 0, body->degree[a], body->origin[a], body->scale[a], 1);
    if (b != DGFEM_NONE) dgfemi_face_side(frame, form->count[0], body->degree[b], body->origin[b], body->scale[b], -1);
    else dgfemi_face_side(frame, form->count[0], frame->degree, frame->centre, frame->scale, -1);
    memset(frame->jump_gram, 0, sizeof frame->jump_gram[0] * (size_t)frame->sides);
    for (int k = 0; k < frame->count; k++)
        for (int l = 0; l < frame->count; l++) {
            dgfem_real moment = frame->moments[dgfemi_product_index(k, l)];
            for (int i = 0; i < frame->sides; i++) frame->jump_gram[i][k] += frame->jump[i][l] * moment;
        }
    dgfemi_face_gradients(frame, 0, form->count[0], 1);
    dgfemi_face_gradients(frame, form->count[0], form->count[1], -1);
}

/* int J_i J_j for j <= i */
static void dgfemi_face_jump_products(const dgfemi_face_frame *frame, dgfem_real *out) {
    for (int i = 0; i < frame->sides; i++)
        for (int j = 0; j <= i; j++) {
            dgfem_real sum = 0;
            for (int k = 0; k < frame->count; k++) sum += frame->jump_gram[i][k] * frame->jump[j][k];
            out[i * frame->sides + j] = sum;
        }
}

/* The in-plane monomials u^i v^j, u = axis[0] . m and v = axis[1] . m, i + j <= degree, written in face monomials m: by
   degree, then i descending. Returns their number. */
static int dgfemi_plane_basis(const dgfem_vec3 axis[2], int degree,
                              dgfem_real basis[DGFEM_MAX_PLANE_BASIS][DGFEM_MAX_BASIS]) {
    int count = 1;
    memset(basis, 0, DGFEM_MAX_PLANE_BASIS * sizeof basis[0]);
    basis[0][0] = 1;
    for (int p = 1; p <= degree; p++) {
        int lower = count - p, lower_count = dgfem_monomial_count(p - 1); /* the monomials of degree p - 1 */
        for (int j = 0; j <= p; j++, count++) {                           /* u^(p-j) v^j = u or v times one of those */
            const dgfem_real *factor = basis[j < p ? lower + j : lower + p - 1];
            for (int k = 0; k < lower_count; k++)
                for (int a = 0; a < 3; a++)
                    basis[count][dgfemi_product_index(k, 1 + a)] += factor[k] * dgfemi_axis(axis[j == p], a);
        }
    }
    return count;
}

/* P_ij for j <= i, P = R^T Gm^-1 R with R = int b J, Gm = int b b^T. Functions that a thin face cannot tell apart are
   dropped. */
static void dgfemi_face_projection(const dgfemi_face_frame *frame, dgfem_real *out) {
    dgfem_real basis[DGFEM_MAX_PLANE_BASIS][DGFEM_MAX_BASIS];
    dgfem_real r[DGFEM_MAX_PLANE_BASIS * 2 * DGFEM_MAX_BASIS], gram[DGFEM_MAX_PLANE_BASIS * DGFEM_MAX_PLANE_BASIS];
    int count = dgfemi_plane_basis(frame->axis, frame->degree - 1, basis), sides = frame->sides;
    for (int m = 0; m < count; m++) {
        for (int i = 0; i < sides; i++) {
            r[m * sides + i] = 0;
            for (int k = 0; k < frame->count; k++) r[m * sides + i] += basis[m][k] * frame->jump_gram[i][k];
        }
        for (int l = 0; l <= m; l++) {
            gram[m * count + l] = 0;
            for (int k = 0; k < frame->count; k++)
                for (int j = 0; j < frame->count; j++) {
                    if (basis[m][k] == 0 || basis[l][j] == 0) continue;
                    gram[m * count + l] += basis[m][k] * basis[l][j] * frame->moments[dgfemi_product_index(k, j)];
                }
        }
    }
    dgfemi_cholesky_dropping(gram, count);
    dgfemi_forward_dense(gram, count, r, sides);
    memset(out, 0, (size_t)sides * (size_t)sides * sizeof(dgfem_real));
    for (int m = 0; m < count; m++)
        for (int i = 0; i < sides; i++)
            for (int j = 0; j <= i; j++) out[i * sides + j] += r[m * sides + i] * r[m * sides + j];
}

/* q_ij = int J_i grad N_j: i and j count the functions of both sides. */
static void dgfemi_face_traction_integral(const dgfemi_face_frame *frame, int i, int j, dgfem_real out[3]) {
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = 0;
        for (int k = 0; k < frame->lower_count; k++) out[axis] += frame->gradient[j][axis][k] * frame->jump_gram[i][k];
    }
}

/* The tractions of a pair, zeros where there are none. */
static void dgfemi_face_pair_tractions(const dgfemi_face_frame *frame, const dgfemi_face_form *form, int i, int j,
                                       dgfem_real *out) {
    for (int k = 0; k < 2; k++, out += 3) {
        int function = k ? i : j, side = function >= form->count[0];
        if (function == (side ? form->count[0] : 0) || !dgfemi_form_has_traction(form, side))
            out[0] = out[1] = out[2] = 0;
        else dgfemi_face_traction_integral(frame, k ? j : i, function, out);
    }
}

/* g_f of the sheet: patch areas over volumes; 4 A/V on a held face, where the one side carries all. */
static dgfem_real dgfemi_face_penalty(const dgfem_mesh *mesh, const dgfemi_face_form *form) {
    const dgfem_real held = 4;
    int a = form->element[0], b = form->element[1];
    dgfem_real g = dgfemi_patch_area(mesh, a, form->face) / mesh->elements[a].volume;
    if (b == DGFEM_NONE) return held * g;
    return g + dgfemi_patch_area(mesh, b, form->face) / mesh->elements[b].volume;
}

static void dgfemi_form_set_counts(const dgfem_body *body, dgfemi_face_form *form) {
    int a = form->element[0], b = form->element[1];
    form->count[0] = dgfem_monomial_count(body->degree[a]);
    form->count[1] = dgfem_monomial_count(body->degree[b == DGFEM_NONE ? a : b]);
}

/* Fills in the integrals of a face whose members face, element, consistent, normal_only and condition are set. 0 when
   out of memory. */
static int dgfemi_forms_set_face(const dgfem_body *body, dgfem_forms *forms, dgfemi_face_form *form) {
    dgfemi_face_frame frame;
    int b = form->element[1];
    dgfemi_form_set_counts(body, form);
    if (!dgfemi_forms_take(forms, &body->hooks, dgfemi_face_form_size(form), &form->data)) return 0;
    dgfemi_face_frame_set(body, form, &frame);
    dgfem_real whole[4 * DGFEM_MAX_BASIS * DGFEM_MAX_BASIS], stiff[4 * DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    dgfemi_face_jump_products(&frame, whole);
    if (body->desc.penalty == DGFEM_PENALTY_SPLIT) dgfemi_face_projection(&frame, stiff);
    else memcpy(stiff, whole, (size_t)frame.sides * (size_t)frame.sides * sizeof *stiff);
    for (int i = 0; i < frame.sides; i++)
        for (int j = 0; j <= i; j++) {
            dgfem_real *pair = dgfemi_form_pair(forms, form, i, j);
            pair[0] = stiff[i * frame.sides + j];
            pair[1] = whole[i * frame.sides + j] - pair[0];
            if (form->consistent) dgfemi_face_pair_tractions(&frame, form, i, j, pair + 2);
        }
    if (b == DGFEM_NONE) memset(dgfemi_form_ghost(forms, form), 0, (size_t)form->count[1] * sizeof(dgfem_vec3));
    dgfem_real penalty = dgfemi_face_penalty(body->mesh, form) * (dgfem_real)(frame.degree * frame.degree);
    form->eta_stiff = body->desc.eta * penalty;
    form->eta_rest = body->desc.eta_rest * penalty;
    form->weight = b == DGFEM_NONE ? 1 : DGFEM_R(0.5);
    return 1;
}

static dgfemi_face_form dgfemi_face_form_make(const dgfem_body *body, int face, int condition, int normal_only) {
    const dgfem_face *f = &body->mesh->faces[face];
    dgfemi_face_form form;
    memset(&form, 0, sizeof form);
    form.face = face;
    form.element[0] = f->element[0], form.element[1] = f->element[1];
    form.consistent = body->desc.flux == DGFEM_FLUX_IP;
    form.normal_only = normal_only;
    form.condition = condition;
    return form;
}

/* A new face form, integrals included; its index, or DGFEM_NONE when out of memory. */
static int dgfemi_forms_add_face(const dgfem_body *body, dgfem_forms *forms, int face, int condition, int normal_only) {
    dgfemi_face_form form = dgfemi_face_form_make(body, face, condition, normal_only);
    if (forms->face_count == forms->face_capacity) {
        void *grown =
            dgfemi_grow(&body->hooks, forms->faces, &forms->face_capacity, forms->face_count + 1, sizeof *forms->faces);
        if (!grown) return DGFEM_NONE;
        forms->faces = (dgfemi_face_form *)grown;
    }
    if (!dgfemi_forms_set_face(body, forms, &form)) return DGFEM_NONE;
    forms->faces[forms->face_count] = form;
    return forms->face_count++;
}

/* Removes the face forms of a condition; the others keep their order. */
static void dgfemi_forms_remove_condition(dgfem_forms *forms, const dgfem_hooks *hooks, int condition) {
    int kept = 0;
    for (int f = 0; f < forms->face_count; f++) {
        const dgfemi_face_form *form = &forms->faces[f];
        if (form->condition == condition) dgfemi_forms_give(forms, hooks, dgfemi_face_form_size(form), form->data);
        else forms->faces[kept++] = *form;
    }
    forms->face_count = kept;
}

static int dgfemi_face_is_glued(const dgfem_face *face) { return face->element[1] != DGFEM_NONE && !face->cut; }

/* Room for exactly the elements and glued faces of a body. 0 when out of memory. */
static int dgfemi_forms_reserve(const dgfem_body *body, dgfem_forms *forms) {
    const dgfem_mesh *mesh = body->mesh;
    size_t size = 0;
    int faces = 0;
    for (int e = 0; e < mesh->element_count; e++)
        size += dgfemi_element_form_size(dgfem_monomial_count(body->degree[e]));
    for (int f = 0; f < mesh->face_count; f++) {
        if (!dgfemi_face_is_glued(&mesh->faces[f])) continue;
        dgfemi_face_form form = dgfemi_face_form_make(body, f, DGFEM_NONE, 0);
        dgfemi_form_set_counts(body, &form);
        size += dgfemi_face_form_size(&form);
        faces++;
    }
    forms->elements =
        (dgfemi_element_form *)dgfemi_allocate(&body->hooks, (size_t)mesh->element_count, sizeof *forms->elements);
    forms->faces = (dgfemi_face_form *)dgfemi_allocate(&body->hooks, (size_t)faces, sizeof *forms->faces);
    forms->data = (dgfem_real *)dgfemi_allocate(&body->hooks, size, sizeof *forms->data);
    if (!forms->elements || !forms->faces || !forms->data) return 0;
    forms->face_capacity = faces;
    forms->data_capacity = size;
    return 1;
}

/* Integrals of all elements and glued faces; NULL when out of memory. */
static dgfem_forms *dgfemi_forms_create(const dgfem_body *body) {
    const dgfem_mesh *mesh = body->mesh;
    dgfem_forms *forms = (dgfem_forms *)dgfemi_allocate_zero(&body->hooks, 1, sizeof *forms);
    if (!forms) return NULL;
    int ok = dgfemi_forms_reserve(body, forms);
    for (int e = 0; ok && e < mesh->element_count; e++) ok = dgfemi_forms_set_element(body, forms, e);
    for (int f = 0; ok && f < mesh->face_count; f++)
        if (dgfemi_face_is_glued(&mesh->faces[f]))
            ok = dgfemi_forms_add_face(body, forms, f, DGFEM_NONE, 0) != DGFEM_NONE;
    if (ok) return forms;
    dgfemi_forms_destroy(forms, &body->hooks);
    return NULL;
}

/* ---- prescribed displacements ---- */

/* Fits the prescribed field on a held face by a polynomial of the element's degree about the face's centre: least
   squares over lattice points of the fan triangles, exact for every polynomial of that degree. The fit lives in the
   plane, along the face's axes of inertia and scaled with its extents, so that neither the normal direction nor a thin
   face make it singular; of what they still leave undetermined, single functions are dropped. */
typedef struct dgfemi_face_fit {
    dgfem_vec3 centre, axis[2];
    dgfem_real scale;
    int degree, count; /* in-plane monomials: 3, 6, 10 */
    dgfem_real gram[DGFEM_MAX_PLANE_BASIS * DGFEM_MAX_PLANE_BASIS];
    dgfem_real rhs[DGFEM_MAX_PLANE_BASIS * 3];
} dgfemi_face_fit;

static void dgfemi_face_fit_sample(dgfemi_face_fit *fit, dgfem_vec3 x, dgfem_vec3 value) {
    dgfem_vec3 d = dgfemi_scale(1 / fit->scale, dgfemi_sub(x, fit->centre));
    dgfem_real u = dgfemi_dot(fit->axis[0], d), v = dgfemi_dot(fit->axis[1], d), b[DGFEM_MAX_PLANE_BASIS];
    int count = 1;
    b[0] = 1;
    for (int p = 1; p <= fit->degree; p++) {
        int lower = count - p; /* the monomials of degree p - 1 */
        for (int j = 0; j <= p; j++) b[count++] = j < p ? u * b[lower + j] : v * b[lower + p - 1];
    }
    for (int i = 0; i < fit->count; i++) {
        for (int j = 0; j < fit->count; j++) fit->gram[i * fit->count + j] += b[i] * b[j];
        fit->rhs[i * 3] += b[i] * value.x;
        fit->rhs[i * 3 + 1] += b[i] * value.y;
        fit->rhs[i * 3 + 2] += b[i] * value.z;
    }
}

static void dgfemi_face_fit_frame(const dgfem_mesh *mesh, int face, int degree, dgfemi_face_fit *fit) {
    dgfem_real moments[DGFEM_MAX_MOMENTS];
    memset(fit, 0, sizeof *fit);
    fit->centre = mesh->faces[face].centre;
    fit->scale = dgfemi_face_radius(mesh, &mesh->faces[face]);
    fit->degree = degree;
    fit->count = (degree + 1) * (degree + 2) / 2;
    dgfemi_mesh_face_moments(mesh, face, 2, fit->centre, fit->scale, moments);
    dgfemi_face_axes(moments, mesh->faces[face].normal, fit->axis);
}

/* Samples the field on a lattice of every triangle (centre, p, q) of the face's loops. */
static void dgfemi_face_fit_samples(const dgfem_mesh *mesh, const dgfem_face *face, dgfemi_face_fit *fit,
                                    dgfem_displacement_fn fn, void *user) {
    int steps = fit->degree + 1;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        dgfem_loop loop = mesh->loops[l];
        for (int k = 0; k < loop.count; k++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[loop.start + k]];
            dgfem_vec3 q = mesh->vertices[mesh->loop_vertices[loop.start + (k + 1) % loop.count]];
            for (int i = 0; i <= steps; i++)
                for (int j = 0; i + j <= steps; j++) {
                    dgfem_real s = (dgfem_real)i / (dgfem_real)steps, t = (dgfem_real)j / (dgfem_real)steps;
                    dgfem_vec3 x = dgfemi_add_scaled(fit->centre, s, dgfemi_sub(p, fit->centre));
                    dgfem_vec3 value = dgfemi_vec3(0, 0, 0);
                    x = dgfemi_add_scaled(x, t, dgfemi_sub(q, fit->centre));
                    fn(user, x, &value);
                    dgfemi_face_fit_sample(fit, x, value);
                }
        }
    }
}

/* ghost[form->count[1]] = the fit of a field on a held face. DGFEM_ERROR_NOT_FINITE where the field is. */
static dgfem_status dgfemi_fit_ghost(const dgfem_body *body, const dgfemi_face_form *form, dgfem_displacement_fn fn,
                                     void *user, dgfem_vec3 *ghost) {
    dgfem_real basis[DGFEM_MAX_PLANE_BASIS][DGFEM_MAX_BASIS];
    dgfemi_face_fit fit;
    dgfemi_face_fit_frame(body->mesh, form->face, body->degree[form->element[0]], &fit);
    dgfemi_face_fit_samples(body->mesh, &body->mesh->faces[form->face], &fit, fn, user);
    for (int i = 0; i < fit.count * 3; i++)
        if (!dgfemi_is_finite(fit.rhs[i]))
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "prescribed displacement on face %d", form->face);
    dgfemi_cholesky_dropping(fit.gram, fit.count);
    dgfemi_cholesky_dense_solve(fit.gram, fit.count, fit.rhs, 3);
    (void)dgfemi_plane_basis(fit.axis, fit.degree, basis);
    memset(ghost, 0, (size_t)form->count[1] * sizeof *ghost);
    for (int m = 0; m < fit.count; m++) {
        dgfem_vec3 c = dgfemi_vec3(fit.rhs[3 * m], fit.rhs[3 * m + 1], fit.rhs[3 * m + 2]);
        for (int k = 0; k < form->count[1]; k++) ghost[k] = dgfemi_add_scaled(ghost[k], basis[m][k], c);
    }
    return DGFEM_OK;
}
