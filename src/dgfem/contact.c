#pragma once
#include "embed.c"
#include "sparse.c"
/* Penalty contact and friction of embedded points against planes and spheres, implicit in the step's velocities.

   A point has the displacement W u and the velocity W v, where the row W holds a coefficient for each basis function of
   the elements it depends on. With its shape's normal n, depth d, velocity v_s and the step h, the force at the end of
   the step is
     f = n (k (d - h n.(w - v_s)) - c n.(w - v_s)) - c_t (I - n n^T)(w - v_s),     w = W v+,
     k = area * stiffness * E / radius of the touched elements, c = damping * k,
     c_t = friction * f_n / max(|v_t|, slip speed),
   that is, the step's system A v+ = b gains A += W^T B W and b += W^T g with
     B = (h^2 k + h c) n n^T + h c_t (I - n n^T),    g = h k d n + B v_s.

   W^T B W couples elements that are not face neighbours, and the graph of A must not change with every contact. With
   a_e the part of W in element e and shares s_e > 0 that sum to one, Cauchy-Schwarz bounds it by diagonal blocks,
     W^T B W  <=  P = blockdiag(a_e^T B a_e / s_e),
   and they agree for a rigid translation where s_e is e's part of the weight and no weight is negative. P takes the
   place of W^T B W in A, and b gains (P - W^T B W) v. Then (P - W^T B W)(v+ - v) is all the difference: it acts on
   changes of velocity only, like mass. Steady states (rest, sliding) are those of the exact contact, and the step stays
   as stable as an implicit one, for P is no smaller than the true Jacobian. (Without that part of b a body is damped
   instead: one that stands on an edge falls over as if in honey.) */

struct dgfem_contacts {
    dgfem_embedding *embedding; /* of the contact points */
    int from_corners;           /* 1: the points are the mesh's boundary corners */
    dgfem_real *area;           /* [points] */
    dgfem_vec3 *sample_value;   /* [samples] */
    dgfem_vec3 *displacement;   /* [points] */
    dgfem_vec3 *velocity;       /* [points] */
    dgfem_real *row;            /* [basis_count] W of one point; zero outside its elements */
    int *element;               /* [elements] elements of the row */
    int element_count;
    dgfem_real *share; /* [elements] s_e of element[i] */
    char *mark;        /* [elements] 1 for the elements of the row */
    char *touched;     /* [elements] 1 for those whose blocks the last assembly has added to */
    dgfem_hooks hooks;
};

/* ---- contact points ---- */

static int dgfemi_face_is_open(const dgfem_face *face) { return face->element[1] == DGFEM_NONE || face->cut; }

/* Shares out the area of a face among its corners, each in proportion to its two edges. */
static void dgfemi_face_share_area(const dgfem_mesh *mesh, const dgfem_face *face, const int *corner_of_vertex,
                                   dgfem_real *area) {
    dgfem_real perimeter = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (int i = 0; i < count; i++) {
                int a = loop[i], b = loop[i + 1 < count ? i + 1 : 0];
                dgfem_real length = dgfemi_distance(mesh->vertices[a], mesh->vertices[b]), half;
                if (pass == 0) perimeter += length;
                if (pass == 0 || !(perimeter > 0)) continue;
                half = DGFEM_R(0.5) * face->area * (length / perimeter);
                area[corner_of_vertex[a]] += half;
                area[corner_of_vertex[b]] += half;
            }
        }
}

/* area[corners]: what each corner has of the boundary and of both sides of cut faces; 0 inside. */
static void dgfemi_corner_areas(const dgfem_mesh *mesh, const dgfem_corners *corners, int *corner_of_vertex,
                                dgfem_real *area) {
    for (int e = 0; e < mesh->element_count; e++) {
        const dgfem_element *element = &mesh->elements[e];
        for (int i = corners->corner_start[e]; i < corners->corner_start[e + 1]; i++)
            corner_of_vertex[corners->vertex[corners->corners[i]]] = corners->corners[i];
        for (int k = element->face_start; k < element->face_start + element->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            if (dgfemi_face_is_open(face)) dgfemi_face_share_area(mesh, face, corner_of_vertex, area);
        }
    }
}

/* Points that are samples themselves: one weight each, 1. */
static int dgfemi_embedding_set_points_to_samples(dgfem_embedding *embedding) {
    const dgfem_hooks *hooks = &embedding->hooks;
    size_t count = (size_t)embedding->sample_count;
    embedding->point_count = embedding->sample_count;
    embedding->points = (dgfem_vec3 *)dgfemi_duplicate(hooks, embedding->samples, count, sizeof(dgfem_vec3));
    embedding->point_element = (int *)dgfemi_allocate(hooks, count, sizeof(int));
    embedding->weight_start = (int *)dgfemi_allocate(hooks, count + 1, sizeof(int));
    embedding->weight_sample = (int *)dgfemi_allocate(hooks, count, sizeof(int));
    embedding->weight = (dgfem_real *)dgfemi_allocate(hooks, count, sizeof(dgfem_real));
    if (!embedding->points || !embedding->point_element || !embedding->weight_start || !embedding->weight_sample ||
        !embedding->weight)
        return 0;
    for (int s = 0; s < embedding->sample_count; s++) {
        embedding->point_element[s] = embedding->term_element[embedding->term_start[s]];
        embedding->weight_start[s] = embedding->weight_sample[s] = s;
        embedding->weight[s] = 1;
    }
    embedding->weight_start[embedding->sample_count] = embedding->sample_count;
    return 1;
}

/* The corners that have a part of the boundary, as an embedding with one sample per point. 1 on success. */
static int dgfemi_contacts_take_corners(dgfemi_arena *arena, dgfem_contacts *contacts, const dgfem_body *body,
                                        const dgfem_corners *corners) {
    size_t count = (size_t)corners->count, terms = (size_t)corners->element_start[corners->count];
    int *corner_of_vertex = (int *)dgfemi_arena_allocate(arena, (size_t)body->mesh->vertex_count, sizeof(int));
    int *start = (int *)dgfemi_arena_allocate(arena, count + 1, sizeof(int));
    int *elements = (int *)dgfemi_arena_allocate(arena, terms, sizeof(int));
    dgfem_vec3 *positions = (dgfem_vec3 *)dgfemi_arena_allocate(arena, count, sizeof(dgfem_vec3));
    int points = 0, term = 0;
    contacts->area = (dgfem_real *)dgfemi_allocate_zero(&contacts->hooks, count, sizeof(dgfem_real));
    if (!corner_of_vertex || !start || !elements || !positions || !contacts->area) return 0;
    dgfemi_corner_areas(body->mesh, corners, corner_of_vertex, contacts->area);
    for (int c = 0; c < corners->count; c++) {
        if (!(contacts->area[c] > 0)) continue;
        contacts->area[points] = contacts->area[c];
        positions[points] = body->mesh->vertices[corners->vertex[c]];
        start[points++] = term;
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++)
            elements[term++] = corners->elements[i];
    }
    start[points] = term;
    return dgfemi_embedding_set_samples(contacts->embedding, body, positions, start, elements, points) &&
           dgfemi_embedding_set_points_to_samples(contacts->embedding);
}

static dgfem_status dgfemi_contacts_embed_corners(dgfem_contacts *contacts, const dgfem_body *body) {
    dgfem_corners *corners;
    dgfemi_arena arena = dgfemi_arena_make(&contacts->hooks);
    dgfem_status status = dgfem_mesh_corners(body->mesh, &corners);
    if (status != DGFEM_OK) return status;
    contacts->embedding = dgfemi_embedding_new(body, &contacts->hooks);
    if (!contacts->embedding || !dgfemi_contacts_take_corners(&arena, contacts, body, corners))
        status = dgfemi_fail_memory(&contacts->hooks);
    dgfemi_arena_free(&arena);
    dgfem_corners_destroy(corners);
    return status;
}

/* All that assembly needs, so that it allocates nothing. 1 on success. */
static int dgfemi_contacts_reserve(dgfem_contacts *contacts, const dgfem_body *body) {
    const dgfem_hooks *hooks = &contacts->hooks;
    size_t points = (size_t)contacts->embedding->point_count, samples = (size_t)contacts->embedding->sample_count;
    size_t elements = (size_t)body->mesh->element_count;
    contacts->sample_value = (dgfem_vec3 *)dgfemi_allocate(hooks, samples, sizeof(dgfem_vec3));
    contacts->displacement = (dgfem_vec3 *)dgfemi_allocate(hooks, points, sizeof(dgfem_vec3));
    contacts->velocity = (dgfem_vec3 *)dgfemi_allocate(hooks, points, sizeof(dgfem_vec3));
    contacts->row = (dgfem_real *)dgfemi_allocate_zero(hooks, (size_t)body->basis_count, sizeof(dgfem_real));
    contacts->element = (int *)dgfemi_allocate(hooks, elements, sizeof(int));
    contacts->share = (dgfem_real *)dgfemi_allocate(hooks, elements, sizeof(dgfem_real));
    contacts->mark = (char *)dgfemi_allocate_zero(hooks, elements, 1);
    contacts->touched = (char *)dgfemi_allocate_zero(hooks, elements, 1);
    return contacts->sample_value && contacts->displacement && contacts->velocity && contacts->row &&
           contacts->element && contacts->share && contacts->mark && contacts->touched;
}

static void dgfemi_contacts_destroy(dgfem_contacts *contacts) {
    dgfem_hooks hooks;
    if (!contacts) return;
    hooks = contacts->hooks;
    dgfem_embedding_destroy(contacts->embedding);
    dgfemi_free(&hooks, contacts->area);
    dgfemi_free(&hooks, contacts->sample_value);
    dgfemi_free(&hooks, contacts->displacement);
    dgfemi_free(&hooks, contacts->velocity);
    dgfemi_free(&hooks, contacts->row);
    dgfemi_free(&hooks, contacts->element);
    dgfemi_free(&hooks, contacts->touched);
    dgfemi_free(&hooks, contacts->share);
    dgfemi_free(&hooks, contacts->mark);
    dgfemi_free(&hooks, contacts);
}

/* Contact points of a body: the given rest positions, each with its area; or, where `points` is NULL, the boundary
   corners of the mesh with their parts of the boundary. `old`: an embedding of the same points in the body before its
   elements changed, or NULL. */
static dgfem_status dgfemi_contacts_create_from(const dgfem_body *body, const dgfem_points_in *points,
                                                const dgfem_real *areas, const dgfem_embedding *old,
                                                dgfem_contacts **out) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_contacts *contacts = (dgfem_contacts *)dgfemi_allocate_zero(hooks, 1, sizeof *contacts);
    dgfem_status status;
    DGFEM_ASSERT(!points || areas);
    if (!contacts) return dgfemi_fail_memory(hooks);
    contacts->hooks = *hooks;
    contacts->from_corners = !points;
    if (points) {
        status = dgfemi_embedding_create_at(body, points, NULL, NULL, old, hooks, &contacts->embedding);
        if (status == DGFEM_OK) {
            contacts->area = (dgfem_real *)dgfemi_duplicate(hooks, areas, (size_t)points->count, sizeof(dgfem_real));
            if (!contacts->area) status = dgfemi_fail_memory(hooks);
        }
    } else {
        status = dgfemi_contacts_embed_corners(contacts, body);
    }
    if (status == DGFEM_OK && !dgfemi_contacts_reserve(contacts, body)) status = dgfemi_fail_memory(hooks);
    if (status != DGFEM_OK) {
        dgfemi_contacts_destroy(contacts);
        return status;
    }
    *out = contacts;
    return DGFEM_OK;
}

static dgfem_status dgfemi_contacts_create(const dgfem_body *body, const dgfem_points_in *points,
                                           const dgfem_real *areas, dgfem_contacts **out) {
    return dgfemi_contacts_create_from(body, points, areas, NULL, out);
}

/* The same contact points for a body whose polynomials or elements have changed. */
static dgfem_status dgfemi_contacts_renew(const dgfem_contacts *old, const dgfem_body *body, dgfem_contacts **out) {
    if (old->from_corners) return dgfemi_contacts_create(body, NULL, NULL, out);
    dgfem_points_in points = dgfem_points_in_vec3(old->embedding->points, old->embedding->point_count);
    return dgfemi_contacts_create_from(body, &points, old->area, old->embedding, out);
}

/* ---- one contact ---- */

DGFEM_API dgfem_real dgfem_shape_distance(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 *normal) {
    const dgfem_shape_desc *desc = &shape->desc;
    if (shape->kind == DGFEM_SHAPE_PLANE) {
        dgfem_real length = dgfemi_norm(desc->plane.normal);
        *normal = dgfemi_scale(1 / length, desc->plane.normal);
        return dgfemi_dot(*normal, x) - desc->plane.offset / length;
    }
    dgfem_vec3 d = dgfemi_sub(x, desc->centre);
    dgfem_real length = dgfemi_norm(d);
    *normal = length > 0 ? dgfemi_scale(1 / length, d) : dgfemi_vec3(0, 0, 1); /* at the centre any direction will do */
    if (desc->radius > 0) return length - desc->radius;
    *normal = dgfemi_scale(-1, *normal);
    return -desc->radius - length;
}

typedef struct dgfemi_contact {
    dgfem_vec3 normal;
    dgfem_real depth; /* at the beginning of the step */
} dgfemi_contact;

/* Whether the point presses against the shape at the end of the step, moving on as it does: one that leaves is not held
   back, one that arrives (depth < 0) is stopped at the surface. Below the surface gravity counts with what it will add,
   and damping acts: without gravity a body at rest would hop by g h^2 forever. Above it must not count: a foot that
   something else wants to lift would be glued to the ground. */
static int dgfemi_contact_is_active(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 v, dgfem_vec3 gravity,
                                    dgfem_real dt, dgfemi_contact *contact) {
    dgfem_vec3 relative = dgfemi_sub(v, shape->desc.velocity);
    dgfem_real delay = dt;
    contact->depth = -dgfem_shape_distance(shape, x, &contact->normal);
    if (contact->depth > 0) {
        relative = dgfemi_add_scaled(relative, dt, gravity);
        delay += shape->desc.damping;
    }
    return contact->depth - delay * dgfemi_dot(contact->normal, relative) > 0;
}

/* Adds B and g of an active contact with stiffness k. Friction follows the normal force that the last step has left,
   k d and its damping: a point that has just arrived feels it one step later, when what stopped it is known. */
static void dgfemi_contact_linearize(const dgfem_shape *shape, const dgfemi_contact *contact, dgfem_vec3 v,
                                     dgfem_real k, dgfem_real dt, dgfem_mat3 *b, dgfem_vec3 *g) {
    const dgfem_shape_desc *desc = &shape->desc;
    dgfem_vec3 n = contact->normal, relative = dgfemi_sub(v, desc->velocity);
    dgfem_real speed = dgfemi_dot(n, relative), normal = dt * dt * k, tangential = 0;
    if (contact->depth > 0) {
        dgfem_real force = k * (contact->depth - desc->damping * speed);
        dgfem_real slip = dgfemi_max(dgfemi_norm(dgfemi_add_scaled(relative, -speed, n)), desc->slip_speed);
        normal += dt * desc->damping * k;
        if (force > 0 && slip > 0) tangential = dt * desc->friction * force / slip;
    }
    for (int i = 0; i < 3; i++) b->m[i][i] += tangential;
    dgfemi_add_outer(b, normal - tangential, n, n);
    speed = dgfemi_dot(n, desc->velocity);
    *g = dgfemi_add_scaled(*g, tangential, desc->velocity);
    *g = dgfemi_add_scaled(*g, dt * k * contact->depth + (normal - tangential) * speed, n);
}

/* ---- rows W ---- */

/* s_e in proportion to the largest coefficient: that of the constant, e's part of the weight, unless weights of both
   signs cancel there. An element whose coefficients all vanish gets 0. */
static void dgfemi_contacts_share_out(dgfem_contacts *contacts, const dgfem_body *body) {
    dgfem_real total = 0;
    for (int i = 0; i < contacts->element_count; i++) {
        int e = contacts->element[i];
        contacts->share[i] = 0;
        for (int j = body->basis_start[e]; j < body->basis_start[e + 1]; j++)
            contacts->share[i] = dgfemi_max(contacts->share[i], dgfemi_abs(contacts->row[j]));
        total += contacts->share[i];
    }
    for (int i = 0; i < contacts->element_count; i++) contacts->share[i] /= total;
}

/* Composes the row of a point from its weights and the terms of their samples. */
static void dgfemi_contacts_compose(dgfem_contacts *contacts, const dgfem_body *body, int point) {
    const dgfem_embedding *embedding = contacts->embedding;
    DGFEM_ASSERT(contacts->element_count == 0);
    for (int i = embedding->weight_start[point]; i < embedding->weight_start[point + 1]; i++) {
        int first = embedding->term_start[embedding->weight_sample[i]];
        int last = embedding->term_start[embedding->weight_sample[i] + 1];
        dgfem_real weight = embedding->weight[i] / (dgfem_real)(last - first);
        for (int t = first; t < last; t++) {
            int e = embedding->term_element[t], start = embedding->term_basis_start[t];
            dgfem_real *row = contacts->row + body->basis_start[e];
            if (!contacts->mark[e]) contacts->mark[e] = 1, contacts->element[contacts->element_count++] = e;
            for (int j = start; j < embedding->term_basis_start[t + 1]; j++)
                row[j - start] += weight * embedding->term_basis[j];
        }
    }
    dgfemi_contacts_share_out(contacts, body);
}

static void dgfemi_contacts_clear_row(dgfem_contacts *contacts, const dgfem_body *body) {
    for (int i = 0; i < contacts->element_count; i++) {
        int e = contacts->element[i];
        contacts->mark[e] = 0;
        for (int j = body->basis_start[e]; j < body->basis_start[e + 1]; j++) contacts->row[j] = 0;
    }
    contacts->element_count = 0;
}

/* E / radius of what the point touches: of its elements, by their shares. */
static dgfem_real dgfemi_contacts_modulus(const dgfem_contacts *contacts, const dgfem_body *body) {
    dgfem_real young = 0, radius = 0;
    for (int i = 0; i < contacts->element_count; i++) {
        young += contacts->share[i] * body->material[contacts->element[i]].young;
        radius += contacts->share[i] * body->mesh->elements[contacts->element[i]].radius;
    }
    return young / radius;
}

/* block += s (a a^T) (x) B,  n basis functions, row-major 3n x 3n. */
static void dgfemi_add_kronecker(dgfem_real *block, const dgfem_real *a, int n, dgfem_real s, const dgfem_mat3 *b) {
    for (int i = 0; i < n; i++)
        for (int p = 0; p < 3; p++) {
            dgfem_real *line = block + (3 * i + p) * 3 * n, factor = s * a[i];
            for (int j = 0; j < n; j++)
                for (int q = 0; q < 3; q++) line[3 * j + q] += factor * a[j] * b->m[p][q];
        }
}

/* matrix += P, rhs += W^T g for the composed row. */
static void dgfemi_contacts_add_row(const dgfem_contacts *contacts, const dgfem_body *body, const dgfem_mat3 *b,
                                    dgfem_vec3 g, dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    for (int i = 0; i < contacts->element_count; i++) {
        int e = contacts->element[i], start = body->basis_start[e], n = body->basis_start[e + 1] - start;
        const dgfem_real *a = contacts->row + start;
        if (!(contacts->share[i] > 0)) continue;
        for (int j = 0; j < n; j++) rhs[start + j] = dgfemi_add_scaled(rhs[start + j], a[j], g);
        dgfemi_add_kronecker(dgfem_matrix_block(matrix, e, e), a, n, 1 / contacts->share[i], b);
        contacts->touched[e] = 1;
    }
}

static dgfem_vec3 dgfemi_row_product(const dgfem_real *a, const dgfem_vec3 *x, int n) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    for (int j = 0; j < n; j++) sum = dgfemi_add_scaled(sum, a[j], x[j]);
    return sum;
}

/* y += (P - W^T B W) x for the composed row. */
static void dgfemi_contacts_add_row_rest(const dgfem_contacts *contacts, const dgfem_body *body, const dgfem_mat3 *b,
                                         const dgfem_vec3 *x, dgfem_vec3 *y) {
    dgfem_vec3 all = dgfemi_vec3(0, 0, 0);
    for (int i = 0; i < contacts->element_count; i++) {
        int start = body->basis_start[contacts->element[i]], n = body->basis_start[contacts->element[i] + 1] - start;
        all = dgfemi_add(all, dgfemi_row_product(contacts->row + start, x + start, n));
    }
    for (int i = 0; i < contacts->element_count; i++) {
        int start = body->basis_start[contacts->element[i]], n = body->basis_start[contacts->element[i] + 1] - start;
        const dgfem_real *a = contacts->row + start;
        dgfem_vec3 part;
        if (!(contacts->share[i] > 0)) continue;
        part = dgfemi_scale(1 / contacts->share[i], dgfemi_row_product(a, x + start, n));
        part = dgfemi_multiply(b, dgfemi_sub(part, all));
        for (int j = 0; j < n; j++) y[start + j] = dgfemi_add_scaled(y[start + j], a[j], part);
    }
}

/* ---- assembly ---- */

/* Adds all contacts of one point. 1 when it has any. */
static int dgfemi_contacts_add_point(dgfem_contacts *contacts, const dgfem_body *body, int point, dgfem_real dt,
                                     dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    dgfem_vec3 x = dgfemi_add(contacts->embedding->points[point], contacts->displacement[point]);
    dgfem_vec3 v = contacts->velocity[point], g = dgfemi_vec3(0, 0, 0);
    dgfem_real modulus = 0;
    dgfem_mat3 b;
    memset(&b, 0, sizeof b);
    for (int s = 0; s < body->shape_count; s++) {
        const dgfem_shape *shape = &body->shapes[s];
        dgfemi_contact contact;
        if (!dgfemi_contact_is_active(shape, x, v, body->desc.gravity, dt, &contact)) continue;
        if (contacts->element_count == 0) {
            dgfemi_contacts_compose(contacts, body, point);
            modulus = dgfemi_contacts_modulus(contacts, body);
        }
        dgfem_real stiffness = contacts->area[point] * shape->desc.stiffness * modulus;
        dgfemi_contact_linearize(shape, &contact, v, stiffness, dt, &b, &g);
    }
    if (contacts->element_count == 0) return 0;
    dgfemi_contacts_add_row(contacts, body, &b, g, matrix, rhs);
    dgfemi_contacts_add_row_rest(contacts, body, &b, body->velocity, rhs);
    dgfemi_contacts_clear_row(contacts, body);
    return 1;
}

/* Adds contact to the step's system A v+ = b; A has the scale of M + h^2 K, b that of M v + h F. Returns the number of
   points in contact. Allocates nothing. */
static int dgfemi_contacts_assemble(dgfem_contacts *contacts, const dgfem_body *body, dgfem_real dt,
                                    dgfem_matrix *matrix, dgfem_vec3 *b) {
    const dgfem_embedding *embedding = contacts->embedding;
    int active = 0;
    memset(contacts->touched, 0, (size_t)body->mesh->element_count);
    dgfemi_embedding_samples(embedding, body, body->displacement, contacts->sample_value);
    dgfemi_embedding_points(embedding, contacts->sample_value, contacts->displacement);
    dgfemi_embedding_samples(embedding, body, body->velocity, contacts->sample_value);
    dgfemi_embedding_points(embedding, contacts->sample_value, contacts->velocity);
    for (int p = 0; p < embedding->point_count; p++)
        active += dgfemi_contacts_add_point(contacts, body, p, dt, matrix, b);
    return active;
}
