#pragma once
#include "linalg.c"
/* The cell complex: storage, measures, compacting, copies, queries, edges.

   Faces own a range of `loops`, loops a range of `loop_vertices`, elements a range of `element_faces`. An edit appends
   the new ranges behind the old ones and marks what it replaces as dead (face: element[0] == DGFEM_NONE, element:
   face_count == 0); dgfemi_mesh_compact removes all that is dead or no longer referenced. Appending may move the
   arrays: hold indices, not pointers, across it. */

static dgfem_mesh *dgfemi_mesh_new(const dgfem_hooks *hooks) {
    dgfem_mesh *mesh = (dgfem_mesh *)dgfemi_allocate_zero(hooks, 1, sizeof *mesh);
    if (mesh) mesh->hooks = *hooks;
    return mesh;
}

DGFEM_API void dgfem_mesh_destroy(dgfem_mesh *mesh) {
    dgfem_hooks hooks;
    if (!mesh) return;
    hooks = mesh->hooks;
    dgfemi_free(&hooks, mesh->vertices);
    dgfemi_free(&hooks, mesh->faces);
    dgfemi_free(&hooks, mesh->elements);
    dgfemi_free(&hooks, mesh->loops);
    dgfemi_free(&hooks, mesh->loop_vertices);
    dgfemi_free(&hooks, mesh->element_faces);
    dgfemi_free(&hooks, mesh);
}

/* ---- appending: the new index, or DGFEM_NONE when out of memory or out of indices ---- */

/* Makes *data hold `extra` more items. 1 on success; on failure 0, and nothing has changed. */
static int dgfemi_mesh_room(const dgfem_hooks *hooks, void **data, int count, int *capacity, int extra, size_t size) {
    void *grown;
    DGFEM_ASSERT(extra >= 0);
    if (extra > INT_MAX - count) return 0;
    if (count + extra <= *capacity) return 1;
    grown = dgfemi_grow(hooks, *data, capacity, count + extra, size);
    if (!grown) return 0;
    *data = grown;
    return 1;
}

/* Room for so many more items of each kind, so that appending them cannot fail. 1 on success. */
static int dgfemi_mesh_reserve(dgfem_mesh *mesh, int vertices, int faces, int elements, int loops, int loop_vertices,
                               int element_faces) {
    const dgfem_hooks *hooks = &mesh->hooks;
    void *data[6];
    int ok;
    data[0] = mesh->vertices, data[1] = mesh->faces, data[2] = mesh->elements;
    data[3] = mesh->loops, data[4] = mesh->loop_vertices, data[5] = mesh->element_faces;
    ok = dgfemi_mesh_room(hooks, &data[0], mesh->vertex_count, &mesh->vertex_capacity, vertices, sizeof(dgfem_vec3)) &&
         dgfemi_mesh_room(hooks, &data[1], mesh->face_count, &mesh->face_capacity, faces, sizeof(dgfem_face)) &&
         dgfemi_mesh_room(hooks, &data[2], mesh->element_count, &mesh->element_capacity, elements,
                          sizeof(dgfem_element)) &&
         dgfemi_mesh_room(hooks, &data[3], mesh->loop_count, &mesh->loop_capacity, loops, sizeof(dgfem_loop)) &&
         dgfemi_mesh_room(hooks, &data[4], mesh->loop_vertex_count, &mesh->loop_vertex_capacity, loop_vertices,
                          sizeof(int)) &&
         dgfemi_mesh_room(hooks, &data[5], mesh->element_face_count, &mesh->element_face_capacity, element_faces,
                          sizeof(int));
    mesh->vertices = (dgfem_vec3 *)data[0], mesh->faces = (dgfem_face *)data[1];
    mesh->elements = (dgfem_element *)data[2], mesh->loops = (dgfem_loop *)data[3];
    mesh->loop_vertices = (int *)data[4], mesh->element_faces = (int *)data[5];
    return ok;
}

/* Appends to one of the two index pools. The source may lie in the pool itself, which may move. */
static int dgfemi_mesh_append(const dgfem_hooks *hooks, int **pool, int *pool_count, int *capacity, const int *source,
                              int count) {
    uintptr_t first = (uintptr_t)*pool, address = (uintptr_t)source;
    int inside = *pool && address >= first && address < (uintptr_t)(*pool + *pool_count);
    size_t offset = inside ? (size_t)(address - first) / sizeof(int) : 0;
    void *data = *pool;
    if (!dgfemi_mesh_room(hooks, &data, *pool_count, capacity, count, sizeof(int))) return DGFEM_NONE;
    *pool = (int *)data;
    if (inside) source = *pool + offset;
    if (count > 0) memcpy(*pool + *pool_count, source, (size_t)count * sizeof(int));
    *pool_count += count;
    return *pool_count - count;
}

static int dgfemi_mesh_add_vertex(dgfem_mesh *mesh, dgfem_vec3 p) {
    if (mesh->vertex_count == mesh->vertex_capacity && !dgfemi_mesh_reserve(mesh, 1, 0, 0, 0, 0, 0)) return DGFEM_NONE;
    mesh->vertices[mesh->vertex_count] = p;
    return mesh->vertex_count++;
}

/* `vertices` may point into mesh->loop_vertices. */
static int dgfemi_mesh_add_loop(dgfem_mesh *mesh, const int *vertices, int count) {
    dgfem_loop loop;
    if (mesh->loop_count == mesh->loop_capacity && !dgfemi_mesh_reserve(mesh, 0, 0, 0, 1, 0, 0)) return DGFEM_NONE;
    loop.count = count;
    loop.start = dgfemi_mesh_append(&mesh->hooks, &mesh->loop_vertices, &mesh->loop_vertex_count,
                                    &mesh->loop_vertex_capacity, vertices, count);
    if (loop.start == DGFEM_NONE) return DGFEM_NONE;
    mesh->loops[mesh->loop_count] = loop;
    return mesh->loop_count++;
}

/* Glued, and not measured yet. */
static int dgfemi_mesh_add_face(dgfem_mesh *mesh, int loop_start, int loop_count, int element0, int element1, int tag,
                                dgfem_vec3 normal) {
    dgfem_face *face;
    if (mesh->face_count == mesh->face_capacity && !dgfemi_mesh_reserve(mesh, 0, 1, 0, 0, 0, 0)) return DGFEM_NONE;
    face = &mesh->faces[mesh->face_count];
    memset(face, 0, sizeof *face);
    face->element[0] = element0, face->element[1] = element1;
    face->loop_start = loop_start, face->loop_count = loop_count;
    face->tag = tag;
    face->normal = normal;
    return mesh->face_count++;
}

/* Not measured yet; the faces' element[] is the caller's to set. `faces` may point into mesh->element_faces. */
static int dgfemi_mesh_add_element(dgfem_mesh *mesh, const int *faces, int count, int tag) {
    dgfem_element *element;
    int start;
    if (!dgfemi_mesh_reserve(mesh, 0, 0, 1, 0, 0, 0)) return DGFEM_NONE;
    start = dgfemi_mesh_append(&mesh->hooks, &mesh->element_faces, &mesh->element_face_count,
                               &mesh->element_face_capacity, faces, count);
    if (start == DGFEM_NONE) return DGFEM_NONE;
    element = &mesh->elements[mesh->element_count];
    memset(element, 0, sizeof *element);
    element->face_start = start, element->face_count = count;
    element->tag = tag;
    return mesh->element_count++;
}

/* ---- measures, always relative to a point nearby: a mesh may stand far from the origin ---- */

/* +1 where the face's normal points out of the element, else -1. */
static int dgfemi_mesh_sign(const dgfem_mesh *mesh, int element, int face) {
    DGFEM_ASSERT(mesh->faces[face].element[0] == element || mesh->faces[face].element[1] == element);
    return mesh->faces[face].element[0] == element ? 1 : -1;
}

/* Area times unit normal, from the loops alone. */
static dgfem_vec3 dgfemi_mesh_vector_area(const dgfem_mesh *mesh, int face) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_vec3 twice = dgfemi_vec3(0, 0, 0);
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = mesh->vertices[loop[0]], b = dgfemi_sub(mesh->vertices[loop[1]], a);
        for (i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], a);
            twice = dgfemi_add(twice, dgfemi_cross(b, c));
            b = c;
        }
    }
    return dgfemi_scale(DGFEM_R(0.5), twice);
}

/* Zero where the loops enclose no area. */
static dgfem_vec3 dgfemi_mesh_unit_normal(const dgfem_mesh *mesh, int face) {
    return dgfemi_normalized(dgfemi_mesh_vector_area(mesh, face));
}

static void dgfemi_mesh_face_box(const dgfem_mesh *mesh, int face, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            *lower = dgfemi_min3(*lower, p);
            *upper = dgfemi_max3(*upper, p);
        }
}

static dgfem_vec3 dgfemi_mesh_first_vertex(const dgfem_mesh *mesh, int face) {
    return mesh->vertices[mesh->loop_vertices[mesh->loops[mesh->faces[face].loop_start].start]];
}

/* origin + moment / measure, kept inside the box: the quotient of a sliver is mostly round-off. */
static dgfem_vec3 dgfemi_mesh_centroid(dgfem_vec3 origin, dgfem_vec3 moment, dgfem_real measure, dgfem_vec3 lower,
                                       dgfem_vec3 upper) {
    dgfem_vec3 middle = dgfemi_add_scaled(lower, DGFEM_R(0.5), dgfemi_sub(upper, lower)), centre;
    if (!(measure > 0)) return middle;
    centre = dgfemi_vec3(origin.x + moment.x / measure, origin.y + moment.y / measure, origin.z + moment.z / measure);
    if (!dgfemi_is_finite3(centre)) return middle;
    return dgfemi_min3(dgfemi_max3(centre, lower), upper);
}

/* Centre and area of a face. The stored normal is used, and the area is that of the projection along it: it may be
   inherited and better than what the vertices of a sliver give. */
static void dgfemi_mesh_face_measures(const dgfem_mesh *mesh, int face, dgfem_vec3 *centre, dgfem_real *area) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_vec3 origin = dgfemi_mesh_first_vertex(mesh, face), lower = origin, upper = origin;
    dgfem_vec3 moment = dgfemi_vec3(0, 0, 0); /* 6 * first moment about the origin */
    dgfem_real twice = 0;                     /* 2 * area */
    int l, i;
    dgfemi_mesh_face_box(mesh, face, &lower, &upper);
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = dgfemi_sub(mesh->vertices[loop[0]], origin), b = dgfemi_sub(mesh->vertices[loop[1]], origin);
        for (i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], origin);
            dgfem_real s = dgfemi_dot(f->normal, dgfemi_cross(dgfemi_sub(b, a), dgfemi_sub(c, a)));
            twice += s;
            moment = dgfemi_add_scaled(moment, s, dgfemi_add(a, dgfemi_add(b, c)));
            b = c;
        }
    }
    *centre = dgfemi_mesh_centroid(origin, moment, 3 * twice, lower, upper);
    *area = dgfemi_max(DGFEM_R(0.5) * twice, 0);
}

static void dgfemi_mesh_measure_face(dgfem_mesh *mesh, int face) {
    dgfem_face *f = &mesh->faces[face];
    dgfemi_mesh_face_measures(mesh, face, &f->centre, &f->area);
}

/* Adds the tetrahedra between the origin and the fan of each loop of a face:
   volume += 6 V, moment += 24 * first moment about the origin. */
static void dgfemi_mesh_add_fan(const dgfem_mesh *mesh, int face, dgfem_real sign, dgfem_vec3 origin,
                                dgfem_real *volume, dgfem_vec3 *moment) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = dgfemi_sub(mesh->vertices[loop[0]], origin), b = dgfemi_sub(mesh->vertices[loop[1]], origin);
        for (i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], origin);
            dgfem_real s = sign * dgfemi_dot(a, dgfemi_cross(b, c));
            *volume += s;
            *moment = dgfemi_add_scaled(*moment, s, dgfemi_add(a, dgfemi_add(b, c)));
            b = c;
        }
    }
}

/* Largest distance of a vertex of the element from a point. */
static dgfem_real dgfemi_mesh_element_reach(const dgfem_mesh *mesh, int element, dgfem_vec3 point) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real square = 0;
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *f = &mesh->faces[mesh->element_faces[k]];
        for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) {
                int v = mesh->loop_vertices[mesh->loops[l].start + i];
                dgfem_vec3 d = dgfemi_sub(mesh->vertices[v], point);
                square = dgfemi_max(square, dgfemi_dot(d, d));
            }
    }
    return dgfemi_sqrt(square);
}

static void dgfemi_mesh_element_box(const dgfem_mesh *mesh, int element, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    const dgfem_element *e = &mesh->elements[element];
    int k;
    *lower = *upper = dgfemi_mesh_first_vertex(mesh, mesh->element_faces[e->face_start]);
    for (k = e->face_start; k < e->face_start + e->face_count; k++)
        dgfemi_mesh_face_box(mesh, mesh->element_faces[k], lower, upper);
}

/* Centre and signed volume of an element with this bounding box. Neighbours fan their common face alike, so volumes of
   elements add up to that of the whole even where a face is not quite planar. */
static void dgfemi_mesh_element_measures(const dgfem_mesh *mesh, int element, dgfem_vec3 lower, dgfem_vec3 upper,
                                         dgfem_vec3 *centre, dgfem_real *volume) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_vec3 origin = dgfemi_add_scaled(lower, DGFEM_R(0.5), dgfemi_sub(upper, lower)), moment = dgfemi_vec3(0, 0, 0);
    dgfem_real six = 0; /* 6 * volume */
    int k;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int face = mesh->element_faces[k];
        dgfemi_mesh_add_fan(mesh, face, (dgfem_real)dgfemi_mesh_sign(mesh, element, face), origin, &six, &moment);
    }
    *volume = six / 6;
    *centre = dgfemi_mesh_centroid(origin, moment, 4 * six, lower, upper);
}

static void dgfemi_mesh_measure_element(dgfem_mesh *mesh, int element) {
    dgfem_element *e = &mesh->elements[element];
    dgfem_vec3 lower, upper;
    dgfemi_mesh_element_box(mesh, element, &lower, &upper);
    dgfemi_mesh_element_measures(mesh, element, lower, upper, &e->centre, &e->volume);
    e->radius = dgfemi_mesh_element_reach(mesh, element, e->centre);
}

/* ---- compacting ---- */

/* The new pools and the new index of every old item. */
typedef struct dgfemi_mesh_packing {
    dgfem_loop *loops;
    int *loop_vertices, *element_faces;
    int loop_count, loop_vertex_count, element_face_count;
    int *vertex_map, *face_map, *element_map; /* old -> new, DGFEM_NONE for what goes */
} dgfemi_mesh_packing;

static int dgfemi_mesh_packing_allocate(const dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    const dgfem_hooks *hooks = &mesh->hooks;
    size_t loops = 0, loop_vertices = 0, element_faces = 0;
    int e, f, l;
    for (f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[0] == DGFEM_NONE) continue;
        loops += (size_t)face->loop_count;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            loop_vertices += (size_t)mesh->loops[l].count;
    }
    for (e = 0; e < mesh->element_count; e++) element_faces += (size_t)mesh->elements[e].face_count;
    memset(packing, 0, sizeof *packing);
    packing->loops = (dgfem_loop *)dgfemi_allocate(hooks, loops, sizeof(dgfem_loop));
    packing->loop_vertices = (int *)dgfemi_allocate(hooks, loop_vertices, sizeof(int));
    packing->element_faces = (int *)dgfemi_allocate(hooks, element_faces, sizeof(int));
    packing->vertex_map = (int *)dgfemi_allocate(hooks, (size_t)mesh->vertex_count, sizeof(int));
    packing->face_map = (int *)dgfemi_allocate(hooks, (size_t)mesh->face_count, sizeof(int));
    packing->element_map = (int *)dgfemi_allocate(hooks, (size_t)mesh->element_count, sizeof(int));
    return packing->loops && packing->loop_vertices && packing->element_faces && packing->vertex_map &&
           packing->face_map && packing->element_map;
}

static void dgfemi_mesh_packing_free(const dgfem_hooks *hooks, dgfemi_mesh_packing *packing) {
    dgfemi_free(hooks, packing->loops);
    dgfemi_free(hooks, packing->loop_vertices);
    dgfemi_free(hooks, packing->element_faces);
    dgfemi_free(hooks, packing->vertex_map);
    dgfemi_free(hooks, packing->face_map);
    dgfemi_free(hooks, packing->element_map);
}

/* Numbers what stays. */
static void dgfemi_mesh_packing_map(const dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    int e, f, l, i, v, next_vertex = 0, next_face = 0, next_element = 0;
    for (v = 0; v < mesh->vertex_count; v++) packing->vertex_map[v] = DGFEM_NONE;
    for (f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        packing->face_map[f] = face->element[0] == DGFEM_NONE ? DGFEM_NONE : next_face++;
        if (face->element[0] == DGFEM_NONE) continue;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++)
                packing->vertex_map[mesh->loop_vertices[mesh->loops[l].start + i]] = 0;
    }
    for (v = 0; v < mesh->vertex_count; v++)
        if (packing->vertex_map[v] != DGFEM_NONE) packing->vertex_map[v] = next_vertex++;
    for (e = 0; e < mesh->element_count; e++)
        packing->element_map[e] = mesh->elements[e].face_count == 0 ? DGFEM_NONE : next_element++;
}

/* Moves the live faces down and copies their loops into the new pools, in the order of the faces. */
static void dgfemi_mesh_pack_faces(dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    int f, l, i, kept = 0;
    for (f = 0; f < mesh->face_count; f++) {
        dgfem_face face = mesh->faces[f];
        int first = packing->loop_count;
        if (packing->face_map[f] == DGFEM_NONE) continue;
        for (l = face.loop_start; l < face.loop_start + face.loop_count; l++) {
            dgfem_loop *loop = &packing->loops[packing->loop_count++];
            loop->start = packing->loop_vertex_count;
            loop->count = mesh->loops[l].count;
            for (i = 0; i < loop->count; i++)
                packing->loop_vertices[packing->loop_vertex_count++] =
                    packing->vertex_map[mesh->loop_vertices[mesh->loops[l].start + i]];
        }
        for (i = 0; i < 2; i++) {
            if (face.element[i] == DGFEM_NONE) continue;
            face.element[i] = packing->element_map[face.element[i]];
            DGFEM_ASSERT(face.element[i] != DGFEM_NONE); /* a live face of a dead element */
        }
        face.loop_start = first;
        mesh->faces[kept++] = face;
    }
    mesh->face_count = kept;
}

static void dgfemi_mesh_pack_elements(dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    int e, k, kept = 0;
    for (e = 0; e < mesh->element_count; e++) {
        dgfem_element element = mesh->elements[e];
        int first = packing->element_face_count;
        if (packing->element_map[e] == DGFEM_NONE) continue;
        for (k = element.face_start; k < element.face_start + element.face_count; k++) {
            int face = packing->face_map[mesh->element_faces[k]];
            DGFEM_ASSERT(face != DGFEM_NONE); /* a live element with a dead face */
            packing->element_faces[packing->element_face_count++] = face;
        }
        element.face_start = first;
        mesh->elements[kept++] = element;
    }
    mesh->element_count = kept;
}

static void dgfemi_mesh_pack_vertices(dgfem_mesh *mesh, const dgfemi_mesh_packing *packing) {
    int v, kept = 0;
    for (v = 0; v < mesh->vertex_count; v++)
        if (packing->vertex_map[v] != DGFEM_NONE) mesh->vertices[kept++] = mesh->vertices[v];
    mesh->vertex_count = kept;
}

/* The packing receives the old pools, to be freed with it. */
static void dgfemi_mesh_take_pools(dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    dgfem_loop *loops = mesh->loops;
    int *loop_vertices = mesh->loop_vertices, *element_faces = mesh->element_faces;
    mesh->loops = packing->loops, packing->loops = loops;
    mesh->loop_vertices = packing->loop_vertices, packing->loop_vertices = loop_vertices;
    mesh->element_faces = packing->element_faces, packing->element_faces = element_faces;
    mesh->loop_count = mesh->loop_capacity = packing->loop_count;
    mesh->loop_vertex_count = mesh->loop_vertex_capacity = packing->loop_vertex_count;
    mesh->element_face_count = mesh->element_face_capacity = packing->element_face_count;
}

/* Drops dead faces and elements and all loops and vertices that nothing refers to; the rest keeps its order and its
   measures and gets new indices. Logs when out of memory, and then the mesh is unchanged. */
static dgfem_status dgfemi_mesh_compact(dgfem_mesh *mesh) {
    dgfemi_mesh_packing packing;
    if (!dgfemi_mesh_packing_allocate(mesh, &packing)) {
        dgfemi_mesh_packing_free(&mesh->hooks, &packing);
        return dgfemi_fail_memory(&mesh->hooks);
    }
    dgfemi_mesh_packing_map(mesh, &packing);
    dgfemi_mesh_pack_faces(mesh, &packing);
    dgfemi_mesh_pack_elements(mesh, &packing);
    dgfemi_mesh_pack_vertices(mesh, &packing);
    dgfemi_mesh_take_pools(mesh, &packing);
    dgfemi_mesh_packing_free(&mesh->hooks, &packing);
    return DGFEM_OK;
}

/* ---- copies ---- */

/* Gives both meshes each other's content; the hooks go along. */
static void dgfemi_mesh_swap(dgfem_mesh *a, dgfem_mesh *b) {
    dgfem_mesh c = *a;
    *a = *b;
    *b = c;
}

/* Does not log. */
static dgfem_mesh *dgfemi_mesh_duplicate(const dgfem_mesh *mesh) {
    dgfem_mesh *copy = dgfemi_mesh_new(&mesh->hooks);
    if (!copy) return NULL;
    if (!dgfemi_mesh_reserve(copy, mesh->vertex_count, mesh->face_count, mesh->element_count, mesh->loop_count,
                             mesh->loop_vertex_count, mesh->element_face_count)) {
        dgfem_mesh_destroy(copy);
        return NULL;
    }
#define DGFEM_COPY_ARRAY(array, count, type)                                                                           \
    if (mesh->count > 0) memcpy(copy->array, mesh->array, (size_t)mesh->count * sizeof(type));                         \
    copy->count = mesh->count
    DGFEM_COPY_ARRAY(vertices, vertex_count, dgfem_vec3);
    DGFEM_COPY_ARRAY(faces, face_count, dgfem_face);
    DGFEM_COPY_ARRAY(elements, element_count, dgfem_element);
    DGFEM_COPY_ARRAY(loops, loop_count, dgfem_loop);
    DGFEM_COPY_ARRAY(loop_vertices, loop_vertex_count, int);
    DGFEM_COPY_ARRAY(element_faces, element_face_count, int);
#undef DGFEM_COPY_ARRAY
    return copy;
}

DGFEM_API dgfem_status dgfem_mesh_copy(const dgfem_mesh *mesh, dgfem_mesh **out) {
    if (out) *out = NULL;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "nowhere to put the copy of the mesh");
    *out = dgfemi_mesh_duplicate(mesh);
    return *out ? DGFEM_OK : dgfemi_fail_memory(&mesh->hooks);
}

/* ---- queries ---- */

DGFEM_API dgfem_real dgfem_mesh_volume(const dgfem_mesh *mesh) {
    double sum = 0;
    int e;
    for (e = 0; mesh && e < mesh->element_count; e++) sum += (double)mesh->elements[e].volume;
    return (dgfem_real)sum;
}

DGFEM_API dgfem_real dgfem_mesh_boundary_area(const dgfem_mesh *mesh) {
    double sum = 0;
    int f;
    for (f = 0; mesh && f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] == DGFEM_NONE) sum += (double)mesh->faces[f].area;
    return (dgfem_real)sum;
}

/* Largest distance of a vertex of the face from a plane with unit normal. */
static dgfem_real dgfemi_mesh_face_off_plane(const dgfem_mesh *mesh, int face, dgfem_vec3 normal, dgfem_real offset) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_real largest = 0;
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            largest = dgfemi_max(largest, dgfemi_abs(dgfemi_dot(normal, p) - offset));
        }
    return largest;
}

DGFEM_API int dgfem_mesh_faces_on_plane(const dgfem_mesh *mesh, dgfem_plane plane, dgfem_real tolerance, int *faces,
                                        int capacity) {
    int f, count = 0;
    for (f = 0; mesh && f < mesh->face_count; f++) {
        if (mesh->faces[f].element[1] != DGFEM_NONE) continue;
        if (!(dgfemi_mesh_face_off_plane(mesh, f, plane.normal, plane.offset) <= tolerance)) continue;
        if (faces && count < capacity) faces[count] = f;
        count++;
    }
    return count;
}

/* ---- pieces: elements that glued faces hold together ---- */

/* Gives all elements that hang together with `first` the number `piece`; stack[element_count]. */
static void dgfemi_mesh_flood(const dgfem_mesh *mesh, int first, int piece, int *piece_of, int *stack) {
    int count = 0, k;
    stack[count++] = first;
    piece_of[first] = piece;
    while (count > 0) {
        int element = stack[--count];
        const dgfem_element *e = &mesh->elements[element];
        for (k = e->face_start; k < e->face_start + e->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            int other = face->element[0] == element ? face->element[1] : face->element[0];
            if (other == DGFEM_NONE || face->cut || piece_of[other] != DGFEM_NONE) continue;
            piece_of[other] = piece;
            stack[count++] = other;
        }
    }
}

/* piece_of[element_count], numbered in the order of their first elements; stack[element_count]. Returns their number. */
static int dgfemi_mesh_pieces(const dgfem_mesh *mesh, int *piece_of, int *stack) {
    int count = 0, e;
    for (e = 0; e < mesh->element_count; e++) piece_of[e] = DGFEM_NONE;
    for (e = 0; e < mesh->element_count; e++)
        if (piece_of[e] == DGFEM_NONE) dgfemi_mesh_flood(mesh, e, count++, piece_of, stack);
    return count;
}

/* ---- vertices of elements ---- */

/* The largest number of loop vertices, repeats included, that an element has: room for dgfemi_mesh_element_vertices. */
static int dgfemi_mesh_max_element_corners(const dgfem_mesh *mesh) {
    int e, k, l, largest = 0;
    for (e = 0; e < mesh->element_count; e++) {
        const dgfem_element *element = &mesh->elements[e];
        int sum = 0;
        for (k = element->face_start; k < element->face_start + element->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) sum += mesh->loops[l].count;
        }
        if (sum > largest) largest = sum;
    }
    return largest;
}

/* Writes the distinct vertices of an element in the order of their first use; returns their number.
   mark[vertex_count] holds `element` nowhere before and at those vertices after the call, so that one array serves all
   elements in turn. */
static int dgfemi_mesh_element_vertices(const dgfem_mesh *mesh, int element, int *mark, int *vertices) {
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i, count = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) {
                int v = mesh->loop_vertices[mesh->loops[l].start + i];
                if (mark[v] == element) continue;
                mark[v] = element;
                vertices[count++] = v;
            }
    }
    return count;
}

/* ---- hashing ---- */

static uint64_t dgfemi_mix(uint64_t x) {
    x = (x ^ (x >> 30)) * ((uint64_t)0xbf58476du << 32 | 0x1ce4e5b9u);
    x = (x ^ (x >> 27)) * ((uint64_t)0x94d049bbu << 32 | 0x133111ebu);
    return x ^ (x >> 31);
}

static uint64_t dgfemi_hash_pair(int a, int b) { return dgfemi_mix((uint64_t)(unsigned)a << 32 | (unsigned)b); }

/* Items 0, 1, 2, ... chained by hash. The caller compares:
   for (i = dgfemi_buckets_first(&b, hash); i != DGFEM_NONE; i = b.next[i]) ... */
typedef struct dgfemi_buckets {
    int *first; /* [mask + 1] */
    int *next;  /* [next_capacity] */
    uint64_t mask;
    int first_capacity, next_capacity;
} dgfemi_buckets;

/* Empties the table and fits it to about so many items. 1 on success, 0 when out of memory. */
static int dgfemi_buckets_reset(const dgfem_hooks *hooks, dgfemi_buckets *buckets, int items) {
    int size = 16, i;
    while (size < items && size < (1 << 30)) size *= 2;
    if (size > buckets->first_capacity) {
        int *grown = (int *)dgfemi_grow(hooks, buckets->first, &buckets->first_capacity, size, sizeof(int));
        if (!grown) return 0;
        buckets->first = grown;
    }
    buckets->mask = (uint64_t)size - 1;
    for (i = 0; i < size; i++) buckets->first[i] = DGFEM_NONE;
    return 1;
}

static int dgfemi_buckets_first(const dgfemi_buckets *buckets, uint64_t hash) {
    return buckets->first[hash & buckets->mask];
}

/* Items may come in any order, each once. 1 on success, 0 when out of memory. */
static int dgfemi_buckets_insert(const dgfem_hooks *hooks, dgfemi_buckets *buckets, int item, uint64_t hash) {
    if (item >= buckets->next_capacity) {
        int *grown = (int *)dgfemi_grow(hooks, buckets->next, &buckets->next_capacity, item + 1, sizeof(int));
        if (!grown) return 0;
        buckets->next = grown;
    }
    buckets->next[item] = buckets->first[hash & buckets->mask];
    buckets->first[hash & buckets->mask] = item;
    return 1;
}

static void dgfemi_buckets_free(const dgfem_hooks *hooks, dgfemi_buckets *buckets) {
    dgfemi_free(hooks, buckets->first);
    dgfemi_free(hooks, buckets->next);
}

/* ---- edges ---- */

/* An undirected edge a < b and how often faces run along it either way. */
typedef struct dgfemi_edge {
    int a, b;
    int forward, backward; /* uses a -> b and b -> a */
} dgfemi_edge;

/* Zeroed memory is a valid empty table. */
typedef struct dgfemi_edges {
    dgfemi_edge *data;
    int count, capacity;
    dgfemi_buckets buckets;
} dgfemi_edges;

static void dgfemi_edges_free(const dgfem_hooks *hooks, dgfemi_edges *edges) {
    dgfemi_free(hooks, edges->data);
    dgfemi_buckets_free(hooks, &edges->buckets);
}

/* Empties the table and makes room for so many edges, so that adding them cannot fail. 1 on success. */
static int dgfemi_edges_reset(const dgfem_hooks *hooks, dgfemi_edges *edges, int count) {
    void *data = edges->data, *next = edges->buckets.next;
    int ok = dgfemi_mesh_room(hooks, &data, 0, &edges->capacity, count, sizeof(dgfemi_edge)) &&
             dgfemi_mesh_room(hooks, &next, 0, &edges->buckets.next_capacity, count, sizeof(int));
    edges->data = (dgfemi_edge *)data, edges->buckets.next = (int *)next;
    edges->count = 0;
    return ok && dgfemi_buckets_reset(hooks, &edges->buckets, count);
}

static void dgfemi_edges_add(const dgfem_hooks *hooks, dgfemi_edges *edges, int from, int to) {
    int a = from < to ? from : to, b = from < to ? to : from, i;
    uint64_t hash = dgfemi_hash_pair(a, b);
    dgfemi_edge *edge;
    for (i = dgfemi_buckets_first(&edges->buckets, hash); i != DGFEM_NONE; i = edges->buckets.next[i])
        if (edges->data[i].a == a && edges->data[i].b == b) break;
    if (i == DGFEM_NONE) {
        DGFEM_ASSERT(edges->count < edges->capacity && edges->count < edges->buckets.next_capacity);
        i = edges->count++;
        memset(&edges->data[i], 0, sizeof(dgfemi_edge));
        edges->data[i].a = a, edges->data[i].b = b;
        (void)dgfemi_buckets_insert(hooks, &edges->buckets, i, hash);
    }
    edge = &edges->data[i];
    if (from == a) edge->forward++;
    else edge->backward++;
}

/* Adds the edges of a face as seen from outside one of its elements (sign as dgfemi_mesh_sign). */
static void dgfemi_edges_add_face(const dgfem_mesh *mesh, dgfemi_edges *edges, int face, int sign) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, last = loop[count - 1];
        for (i = 0; i < count; i++) {
            dgfemi_edges_add(&mesh->hooks, edges, sign > 0 ? last : loop[i], sign > 0 ? loop[i] : last);
            last = loop[i];
        }
    }
}

/* Number of loop vertices of a face: that of its edges, too. */
static int dgfemi_mesh_face_corners(const dgfem_mesh *mesh, int face) {
    const dgfem_face *f = &mesh->faces[face];
    int l, sum = 0;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) sum += mesh->loops[l].count;
    return sum;
}
