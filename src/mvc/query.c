#pragma once
#include "solve.c"
/* Questions about a body: its mesh, stress, forces, energy, momentum, volume. */

/* ---- mesh ---- */

static int dgfem_mvci_has_face(const dgfem_mvc *body, int face) { return body && face >= 0 && face < body->face_count; }
static int dgfem_mvci_has_element(const dgfem_mvc *body, int e) { return body && e >= 0 && e < body->element_count; }

/* Copies the first `capacity` of `count` integers; returns count. */
static int dgfem_mvci_answer(const int *from, int count, int *to, int capacity) {
    for (int i = 0; to && i < count && i < capacity; i++) to[i] = from[i];
    return count;
}

DGFEM_API int dgfem_mvc_face_nodes(const dgfem_mvc *body, int face, int *nodes, int capacity) {
    int count;
    if (!dgfem_mvci_has_face(body, face)) return 0;
    const int *loop = dgfem_mvci_face_loop(body->mesh, face, &count);
    return dgfem_mvci_answer(loop, count, nodes, capacity);
}

DGFEM_API int dgfem_mvc_face_triangles(const dgfem_mvc *body, int face, int *triangles, int capacity) {
    int count;
    if (!dgfem_mvci_has_face(body, face)) return 0;
    const int *at = dgfem_mvci_face_triangles(body->mesh, face, &count);
    int room = capacity < count ? capacity : count;
    (void)dgfem_mvci_answer(at, 3 * room, triangles, 3 * room);
    return count;
}

DGFEM_API int dgfem_mvc_element_nodes(const dgfem_mvc *body, int element, int *nodes, int capacity) {
    if (!dgfem_mvci_has_element(body, element)) return 0;
    const int *start = body->system->node_start + element;
    return dgfem_mvci_answer(body->system->nodes + start[0], start[1] - start[0], nodes, capacity);
}

DGFEM_API int dgfem_mvc_element_faces(const dgfem_mvc *body, int element, int *faces, int capacity) {
    int count;
    if (!dgfem_mvci_has_element(body, element)) return 0;
    const int *list = dgfem_mvci_element_faces(body->mesh, element, &count);
    for (int k = 0; faces && k < count && k < capacity; k++) faces[k] = list[k] / 2;
    return count;
}

DGFEM_API void dgfem_mvc_face_elements(const dgfem_mvc *body, int face, int elements[2]) {
    if (!elements) return;
    elements[0] = elements[1] = DGFEM_NONE;
    if (!dgfem_mvci_has_face(body, face)) return;
    elements[0] = body->mesh->faces[face].owner[0];
    elements[1] = body->mesh->faces[face].owner[1];
}

static int dgfem_mvci_is_on_plane(const dgfem_mvc *body, int node, dgfem_plane plane, dgfem_real tolerance) {
    return dgfem_mvci_abs(dgfem_mvci_dot(plane.normal, body->rest[node]) - plane.offset) <= tolerance;
}

DGFEM_API int dgfem_mvc_faces_on_plane(const dgfem_mvc *body, dgfem_plane plane, dgfem_real tolerance, int *faces,
                                       int capacity) {
    int found = 0;
    for (int f = 0; body && f < body->face_count; f++) {
        int count, on = 0;
        const int *loop = dgfem_mvci_face_loop(body->mesh, f, &count);
        if (body->mesh->faces[f].owner[1] != DGFEM_NONE) continue;
        for (int i = 0; i < count; i++) on += dgfem_mvci_is_on_plane(body, loop[i], plane, tolerance);
        if (on < count) continue;
        if (faces && found < capacity) faces[found] = f;
        found++;
    }
    return found;
}

DGFEM_API int dgfem_mvc_nodes_on_plane(const dgfem_mvc *body, dgfem_plane plane, dgfem_real tolerance, int *nodes,
                                       int capacity) {
    int found = 0;
    for (int i = 0; body && i < body->node_count; i++) {
        if (!dgfem_mvci_is_on_plane(body, i, plane, tolerance)) continue;
        if (nodes && found < capacity) nodes[found] = i;
        found++;
    }
    return found;
}

DGFEM_API int dgfem_mvc_boundary_nodes(const dgfem_mvc *body, int *nodes, int capacity) {
    int found = 0;
    for (int i = 0; body && i < body->node_count; i++) {
        if (!(body->area[i] > 0)) continue;
        if (nodes && found < capacity) nodes[found] = i;
        found++;
    }
    return found;
}

DGFEM_API int dgfem_mvc_nearest_node(const dgfem_mvc *body, dgfem_vec3 x) {
    int best = DGFEM_NONE;
    dgfem_real least = 0;
    for (int i = 0; body && i < body->node_count; i++) {
        dgfem_real distance = dgfem_mvci_distance(body->position[i], x);
        if (best == DGFEM_NONE || distance < least) best = i, least = distance;
    }
    return best;
}

/* ---- state ---- */

/* Points given for all nodes. */
static dgfem_status dgfem_mvci_read_nodes(dgfem_mvc *body, const dgfem_points_in *points, const char *what,
                                          dgfem_vec3 *out) {
    dgfem_status status = dgfem_mvci_check_points(&body->hooks, points, what);
    if (!status && points->count != body->node_count)
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "%d %s for %d nodes", points->count, what,
                                 body->node_count);
    for (int i = 0; !status && i < points->count; i++)
        if (!dgfem_mvci_is_finite3(dgfem_mvci_read_point(points, i)))
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s: node %d", what, i);
    for (int i = 0; !status && i < points->count; i++) out[i] = dgfem_mvci_read_point(points, i);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_set_positions(dgfem_mvc *body, dgfem_points_in positions) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_read_nodes(body, &positions, "positions", body->position);
    if (status) return status;
    dgfem_mvci_rotations(body, body->system->next);
    dgfem_mvci_commit_rotations(body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_set_velocities(dgfem_mvc *body, dgfem_points_in velocities) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    return dgfem_mvci_read_nodes(body, &velocities, "velocities", body->velocity);
}

static dgfem_status dgfem_mvci_check_question(const dgfem_mvc *body, int element, const void *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    if (dgfem_mvci_has_element(body, element)) return DGFEM_OK;
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "element %d of %d", element, body->element_count);
}

static dgfem_mat3 dgfem_mvci_rotation_now(const dgfem_mvc *body, int e) {
    return body->desc.warp ? dgfem_mvci_element_rotation(body, e, body->position) : dgfem_mvci_identity();
}

/* The mean strain in the element's frame. */
static dgfem_mat3 dgfem_mvci_local_strain(const dgfem_mvc *body, int e, const dgfem_mat3 *rotation) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 centre = dgfem_mvci_element_mean(body, e, body->position);
    dgfem_mat3 gradient, strain;
    memset(&gradient, 0, sizeof gradient);
    for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
        dgfem_mvci_add_outer(&gradient, 1,
                             dgfem_mvci_local_displacement(body, e, i - system->node_start[e], rotation, centre),
                             system->mean[i]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) strain.m[i][j] = (gradient.m[i][j] + gradient.m[j][i]) / 2;
    return strain;
}

static dgfem_mat3 dgfem_mvci_turn_tensor(const dgfem_mat3 *rotation, const dgfem_mat3 *tensor) {
    dgfem_mat3 back = dgfem_mvci_transposed(rotation), half = dgfem_mvci_multiply3(tensor, &back);
    return dgfem_mvci_multiply3(rotation, &half);
}

DGFEM_API dgfem_status dgfem_mvc_strain(const dgfem_mvc *body, int element, dgfem_mat3 *out) {
    dgfem_status status = dgfem_mvci_check_question(body, element, out);
    if (status) return status;
    dgfem_mat3 rotation = dgfem_mvci_rotation_now(body, element);
    dgfem_mat3 strain = dgfem_mvci_local_strain(body, element, &rotation);
    *out = dgfem_mvci_turn_tensor(&rotation, &strain);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_stress(const dgfem_mvc *body, int element, dgfem_mat3 *out) {
    dgfem_status status = dgfem_mvc_strain(body, element, out);
    if (status) return status;
    dgfem_real mu = dgfem_mvci_shear(body->material[element]), lambda = dgfem_mvci_lambda(body->material[element]);
    dgfem_real pressure = lambda * (out->m[0][0] + out->m[1][1] + out->m[2][2]);
    for (int i = 0; i < 9; i++) out->m[i / 3][i % 3] = 2 * mu * out->m[i / 3][i % 3] + (i % 4 ? 0 : pressure);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_internal_force(const dgfem_mvc *body, dgfem_vec3 *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_mvci_rotations(body, body->system->next);
    dgfem_mvci_forces(body, body->system->next, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_external_force(const dgfem_mvc *body, dgfem_vec3 *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, (size_t)body->node_count * sizeof *out);
    dgfem_mvci_add_external(body, 1, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_element_stiffness(const dgfem_mvc *body, int element, dgfem_real *out) {
    dgfem_status status = dgfem_mvci_check_question(body, element, out);
    if (status) return status;
    const dgfem_real *block = body->system->stiffness + 9 * body->system->pair_start[element];
    int n = body->system->node_start[element + 1] - body->system->node_start[element];
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++, block += 9)
            for (int i = 0; i < 9; i++) {
                out[(3 * a + i / 3) * 3 * n + 3 * b + i % 3] = block[i];
                out[(3 * b + i % 3) * 3 * n + 3 * a + i / 3] = block[i];
            }
    return DGFEM_OK;
}

/* ---- sums ---- */

DGFEM_API dgfem_status dgfem_mvc_energy(const dgfem_mvc *body, dgfem_energy *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, sizeof *out);
    for (int i = 0; i < body->node_count; i++) {
        out->kinetic += body->mass[i] * dgfem_mvci_dot(body->velocity[i], body->velocity[i]) / 2;
        out->gravity -= body->mass[i] * dgfem_mvci_dot(body->desc.gravity, body->position[i]);
    }
    for (int e = 0; e < body->element_count; e++) {
        dgfem_mat3 rotation = dgfem_mvci_rotation_now(body, e);
        out->elastic += dgfem_mvci_element_push(body, e, &rotation);
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_momentum(const dgfem_mvc *body, dgfem_vec3 *linear, dgfem_vec3 *angular) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (linear) *linear = dgfem_mvci_vec3(0, 0, 0);
    if (angular) *angular = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 p = dgfem_mvci_scale(body->mass[i], body->velocity[i]);
        if (linear) *linear = dgfem_mvci_add(*linear, p);
        if (angular) *angular = dgfem_mvci_add(*angular, dgfem_mvci_cross(body->position[i], p));
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_real dgfem_mvc_mass(const dgfem_mvc *body) {
    dgfem_real sum = 0;
    for (int i = 0; body && i < body->node_count; i++) sum += body->mass[i];
    return sum;
}

DGFEM_API dgfem_real dgfem_mvc_rest_volume(const dgfem_mvc *body) {
    return body ? dgfem_mvci_mesh_volume(body->mesh) : 0;
}

DGFEM_API dgfem_real dgfem_mvc_volume(const dgfem_mvc *body) {
    dgfem_real sum = 0;
    for (int f = 0; body && f < body->face_count; f++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, f, &count);
        for (int t = 0; body->mesh->faces[f].owner[1] == DGFEM_NONE && t < count; t++, at += 3) {
            dgfem_vec3 origin = body->position[0], a = dgfem_mvci_sub(body->position[at[0]], origin);
            sum += dgfem_mvci_dot(a, dgfem_mvci_loop_area(body->position, at, 3)) / 6;
        }
    }
    return sum;
}
