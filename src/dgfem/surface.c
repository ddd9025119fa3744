#pragma once
#include "contact.c"
#include "planar.c"
#include "skin.c"
/* The exact boundary of the elements as triangles: faces at the boundary, and cut faces once for each side.

   A vertex is a corner (a class of (vertex, element) pairs, dgfem_mesh_corners) and a smooth part of the surface
   around it. So the surface is watertight where elements are glued and open where they are cut, and has sharp edges
   between walls and the outside. All vertices of one corner move with the mean of its elements' polynomials, eq. (30):
   unlike the MLS value that follows the elements themselves, also where there is one only. */

#define DGFEM_CREASE DGFEM_R(0.5) /* cosine of the angle between faces, at rest, above which their edge is sharp */

/* One side of an open face, and one corner of its loops. */
typedef struct dgfemi_surface_side {
    int face, side, element;
    int first, count; /* its corners */
    int wall;
} dgfemi_surface_side;

typedef struct dgfemi_surface_corner {
    int owner;                  /* face side */
    int corner, next, previous; /* corners of the mesh: of this one and its neighbours along the loop */
    int vertex;                 /* of the mesh */
    int root;                   /* forest over the side corners of one corner: smooth parts */
    int out;                    /* vertex of the surface */
} dgfemi_surface_corner;

typedef struct dgfemi_surface_build {
    const dgfem_mesh *mesh;
    const dgfem_corners *corners;
    dgfemi_surface_side *sides;
    dgfemi_surface_corner *items;
    int side_count, item_count, loop_count; /* loops: the most that a face has */
    int *head, *chain;                      /* side corners of each corner of the mesh */
    int *corner_of_vertex;                  /* within one element */
    int *out_of_vertex;                     /* within one side */
} dgfemi_surface_build;

/* Whether the boundary says by tags what is outside; a boundary face without tag is a wall then. */
static int dgfemi_surface_has_tags(const dgfem_mesh *mesh) {
    for (int f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] == DGFEM_NONE && mesh->faces[f].tag != DGFEM_NONE) return 1;
    return 0;
}

static int dgfemi_surface_allocate(dgfemi_surface_build *build, dgfemi_arena *arena) {
    const dgfem_mesh *mesh = build->mesh;
    size_t sides = 0, items = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        size_t copies = face->element[1] == DGFEM_NONE ? 1 : 2;
        if (!dgfemi_face_is_open(face)) continue;
        sides += copies, items += copies * (size_t)dgfemi_mesh_face_corners(mesh, f);
        if (face->loop_count > build->loop_count) build->loop_count = face->loop_count;
    }
    build->sides = (dgfemi_surface_side *)dgfemi_arena_allocate(arena, sides, sizeof *build->sides);
    build->items = (dgfemi_surface_corner *)dgfemi_arena_allocate(arena, items, sizeof *build->items);
    build->chain = (int *)dgfemi_arena_allocate(arena, items, sizeof(int));
    build->head = (int *)dgfemi_arena_allocate(arena, (size_t)build->corners->count, sizeof(int));
    build->corner_of_vertex = (int *)dgfemi_arena_allocate(arena, (size_t)mesh->vertex_count, sizeof(int));
    build->out_of_vertex = (int *)dgfemi_arena_allocate(arena, (size_t)mesh->vertex_count, sizeof(int));
    return build->sides && build->items && build->chain && build->head && build->corner_of_vertex &&
           build->out_of_vertex;
}

/* Lists a side's loops as its element sees them: those of side 1 run backwards. */
static void dgfemi_surface_add_side(dgfemi_surface_build *build, int face, int side, int wall) {
    const dgfem_mesh *mesh = build->mesh;
    const dgfem_face *f = &mesh->faces[face];
    dgfemi_surface_side *s = &build->sides[build->side_count];
    s->face = face, s->side = side, s->element = f->element[side], s->wall = wall, s->first = build->item_count;
    for (int l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (int i = 0; i < count; i++) {
            dgfemi_surface_corner *item = &build->items[build->item_count++];
            int after = build->corner_of_vertex[loop[(i + 1) % count]];
            int before = build->corner_of_vertex[loop[(i + count - 1) % count]];
            item->owner = build->side_count, item->vertex = loop[i];
            item->corner = build->corner_of_vertex[loop[i]];
            item->next = side ? before : after, item->previous = side ? after : before;
            item->root = build->item_count - 1, item->out = DGFEM_NONE;
        }
    }
    s->count = build->item_count - s->first;
    build->side_count++;
}

/* All open sides, element by element. */
static void dgfemi_surface_add_sides(dgfemi_surface_build *build) {
    const dgfem_mesh *mesh = build->mesh;
    const dgfem_corners *corners = build->corners;
    int tagged = dgfemi_surface_has_tags(mesh);
    for (int e = 0; e < mesh->element_count; e++) {
        const dgfem_element *element = &mesh->elements[e];
        for (int i = corners->corner_start[e]; i < corners->corner_start[e + 1]; i++)
            build->corner_of_vertex[corners->vertex[corners->corners[i]]] = corners->corners[i];
        for (int k = element->face_start; k < element->face_start + element->face_count; k++) {
            int f = mesh->element_faces[k];
            const dgfem_face *face = &mesh->faces[f];
            if (!dgfemi_face_is_open(face)) continue;
            dgfemi_surface_add_side(build, f, face->element[0] != e,
                                    face->element[1] != DGFEM_NONE || (tagged && face->tag == DGFEM_NONE));
        }
    }
    for (int c = 0; c < corners->count; c++) build->head[c] = DGFEM_NONE;
    for (int i = build->item_count - 1; i >= 0; i--) {
        build->chain[i] = build->head[build->items[i].corner];
        build->head[build->items[i].corner] = i;
    }
}

/* ---- smooth parts ---- */

static int dgfemi_surface_root(dgfemi_surface_build *build, int item) {
    while (build->items[item].root != item) item = build->items[item].root;
    return item;
}

static dgfem_vec3 dgfemi_surface_side_normal(const dgfemi_surface_build *build, const dgfemi_surface_side *side) {
    return dgfemi_scale(side->side ? -1 : 1, build->mesh->faces[side->face].normal);
}

/* Whether two side corners of one corner belong to one side, or to two that meet smoothly in an edge there. */
static int dgfemi_surface_is_smooth(const dgfemi_surface_build *build, int a, int b) {
    const dgfemi_surface_corner *p = &build->items[a], *q = &build->items[b];
    const dgfemi_surface_side *s = &build->sides[p->owner], *t = &build->sides[q->owner];
    if (p->owner == q->owner) return 1;
    if (s->wall != t->wall || (p->next != q->previous && p->previous != q->next)) return 0;
    return dgfemi_dot(dgfemi_surface_side_normal(build, s), dgfemi_surface_side_normal(build, t)) >= DGFEM_CREASE;
}

/* Joins the side corners of each corner to smooth parts and numbers these: vertices of the surface. How many? */
static int dgfemi_surface_number(dgfemi_surface_build *build) {
    int count = 0;
    for (int c = 0; c < build->corners->count; c++) {
        for (int a = build->head[c]; a != DGFEM_NONE; a = build->chain[a])
            for (int b = build->chain[a]; b != DGFEM_NONE; b = build->chain[b]) {
                int p = dgfemi_surface_root(build, a), q = dgfemi_surface_root(build, b);
                if (p == q || !dgfemi_surface_is_smooth(build, a, b)) continue;
                build->items[p > q ? p : q].root = p > q ? q : p;
            }
        for (int a = build->head[c]; a != DGFEM_NONE; a = build->chain[a]) {
            int root = dgfemi_surface_root(build, a);
            if (root == a) build->items[a].out = count++;
            else build->items[a].out = build->items[root].out;
        }
    }
    return count;
}

/* ---- triangles ---- */

/* Triangles of one side, as surface vertices. With triangles NULL they are only counted. DGFEM_NONE: out of memory. */
static int dgfemi_surface_triangulate(dgfemi_surface_build *build, dgfemi_arena *arena, int s, int *loop_vertices,
                                      int *loop_start, int *triangles, int capacity) {
    const dgfem_mesh *mesh = build->mesh;
    const dgfemi_surface_side *side = &build->sides[s];
    const dgfem_face *face = &mesh->faces[side->face];
    dgfemi_planar planar;
    dgfemi_triangles list;
    int count = 0;
    for (int l = 0; l < face->loop_count; l++) {
        const dgfem_loop *loop = &mesh->loops[face->loop_start + l];
        loop_start[l] = count;
        memcpy(loop_vertices + count, mesh->loop_vertices + loop->start, (size_t)loop->count * sizeof(int));
        count += loop->count;
    }
    loop_start[face->loop_count] = count;
    if (!dgfemi_planar_make(&planar, arena, mesh->vertices, loop_vertices, loop_start, face->loop_count, face->normal))
        return DGFEM_NONE;
    if (!triangles) return dgfemi_planar_triangle_count(&planar);
    for (int i = side->first; i < side->first + side->count; i++)
        build->out_of_vertex[build->items[i].vertex] = build->items[i].out;
    list.data = triangles, list.capacity = capacity, list.count = 0;
    dgfemi_planar_triangulate(&planar, loop_vertices, &list); /* consumed by now: room for its groups */
    for (int i = 0; i < 3 * list.count; i++) triangles[i] = build->out_of_vertex[triangles[i]];
    for (int i = 0; side->side && i < list.count; i++) {
        int swap = triangles[3 * i + 1];
        triangles[3 * i + 1] = triangles[3 * i + 2], triangles[3 * i + 2] = swap;
    }
    return list.count;
}

/* Counts the triangles (pass 0), then fills them in (pass 1). 1 on success. */
static int dgfemi_surface_add_triangles(dgfemi_surface_build *build, const dgfem_hooks *hooks, dgfem_surface *surface) {
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    int most = 0, total = 0, ok = 1;
    int *vertices, *start;
    for (int s = 0; s < build->side_count; s++)
        if (build->sides[s].count > most) most = build->sides[s].count;
    vertices = (int *)dgfemi_allocate(hooks, (size_t)most + (size_t)build->loop_count + 1, sizeof(int));
    ok = vertices != NULL;
    start = ok ? vertices + most : NULL;
    for (int pass = 0; ok && pass < 2; pass++) {
        int room = total;
        total = 0;
        for (int s = 0; ok && s < build->side_count; s++) {
            const dgfemi_surface_side *side = &build->sides[s];
            int count = dgfemi_surface_triangulate(build, &arena, s, vertices, start,
                                                   pass ? surface->triangles + 3 * total : NULL, room - total);
            dgfemi_arena_free(&arena);
            ok = count != DGFEM_NONE && count <= INT_MAX / 3 - total;
            for (int i = total; ok && pass && i < total + count; i++) {
                surface->element[i] = side->element, surface->face[i] = side->face, surface->wall[i] = side->wall;
                surface->source[i] = build->mesh->faces[side->face].tag;
            }
            if (ok) total += count;
        }
        if (!ok || pass) break;
        surface->triangle_count = total;
        surface->triangles = (int *)dgfemi_allocate(hooks, 3 * (size_t)total, sizeof(int));
        surface->element = (int *)dgfemi_allocate(hooks, (size_t)total, sizeof(int));
        surface->face = (int *)dgfemi_allocate(hooks, (size_t)total, sizeof(int));
        surface->source = (int *)dgfemi_allocate(hooks, (size_t)total, sizeof(int));
        surface->wall = (int *)dgfemi_allocate(hooks, (size_t)total, sizeof(int));
        ok = surface->triangles && surface->element && surface->face && surface->source && surface->wall;
    }
    dgfemi_free(hooks, vertices);
    return ok;
}

/* ---- positions ---- */

/* The corners in use, as samples, and the sample of each vertex. 1 on success. */
static int dgfemi_surface_sample(dgfemi_surface_build *build, dgfemi_arena *arena, const dgfem_body *body,
                                 dgfem_surface *surface) {
    const dgfem_corners *corners = build->corners;
    size_t count = (size_t)corners->count;
    dgfem_vec3 *positions = (dgfem_vec3 *)dgfemi_arena_allocate(arena, count, sizeof(dgfem_vec3));
    int *start = (int *)dgfemi_arena_allocate(arena, count + 1, sizeof(int));
    int *elements = (int *)dgfemi_arena_allocate(arena, (size_t)corners->element_start[corners->count], sizeof(int));
    int samples = 0, terms = 0;
    surface->sample = (int *)dgfemi_allocate(&surface->hooks, (size_t)surface->vertex_count, sizeof(int));
    if (!positions || !start || !elements || !surface->sample) return 0;
    for (int c = 0; c < corners->count; c++) {
        if (build->head[c] == DGFEM_NONE) continue;
        for (int i = build->head[c]; i != DGFEM_NONE; i = build->chain[i])
            surface->sample[build->items[i].out] = samples;
        positions[samples] = build->mesh->vertices[corners->vertex[c]];
        start[samples++] = terms;
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++)
            elements[terms++] = corners->elements[i];
    }
    start[samples] = terms;
    if (!dgfemi_embedding_set_samples(surface->embedding, body, positions, start, elements, samples)) return 0;
    surface->sample_displacement = (dgfem_vec3 *)dgfemi_allocate(&surface->hooks, (size_t)samples, sizeof(dgfem_vec3));
    return surface->sample_displacement != NULL;
}

static void dgfemi_surface_positions_range(void *context, int first, int last) {
    dgfem_surface *surface = (dgfem_surface *)context;
    for (int v = first; v < last; v++)
        surface->positions[v] = dgfemi_add(surface->embedding->samples[surface->sample[v]],
                                           surface->sample_displacement[surface->sample[v]]);
}

static void dgfemi_surface_update(dgfem_surface *surface, const dgfem_body *body) {
    dgfemi_shell shell;
    dgfemi_embedding_samples(surface->embedding, body, body->displacement, surface->sample_displacement);
    dgfemi_parallel_for(&surface->hooks, surface->vertex_count, DGFEM_SKIN_GRAIN, dgfemi_surface_positions_range,
                        surface);
    shell.positions = surface->positions, shell.triangles = surface->triangles, shell.normals = surface->normals;
    shell.corner_start = surface->corner_start, shell.corners = surface->corners;
    dgfemi_parallel_for(&surface->hooks, surface->vertex_count, DGFEM_SKIN_GRAIN, dgfemi_shell_normals_range, &shell);
}

DGFEM_API dgfem_status dgfem_surface_update(dgfem_surface *surface, const dgfem_body *body) {
    if (!surface) return DGFEM_ERROR_ARGUMENT;
    if (!body) return dgfemi_fail(&surface->hooks, DGFEM_ERROR_ARGUMENT, "surface: no body");
    if (surface->embedding->revision != body->revision)
        return dgfemi_fail(&surface->hooks, DGFEM_ERROR_REVISION,
                           "surface: made for revision %d of the body, which is at %d", surface->embedding->revision,
                           body->revision);
    dgfemi_surface_update(surface, body);
    return DGFEM_OK;
}

/* ---- creation ---- */

DGFEM_API void dgfem_surface_destroy(dgfem_surface *surface) {
    dgfem_hooks hooks;
    if (!surface) return;
    hooks = surface->hooks;
    dgfem_embedding_destroy(surface->embedding);
    dgfemi_free(&hooks, surface->positions);
    dgfemi_free(&hooks, surface->normals);
    dgfemi_free(&hooks, surface->triangles);
    dgfemi_free(&hooks, surface->element);
    dgfemi_free(&hooks, surface->face);
    dgfemi_free(&hooks, surface->source);
    dgfemi_free(&hooks, surface->wall);
    dgfemi_free(&hooks, surface->corner_start);
    dgfemi_free(&hooks, surface->corners);
    dgfemi_free(&hooks, surface->sample);
    dgfemi_free(&hooks, surface->sample_displacement);
    dgfemi_free(&hooks, surface);
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_surface_fill(dgfemi_arena *arena, const dgfem_body *body, const dgfem_corners *corners,
                               dgfem_surface *surface) {
    const dgfem_hooks *hooks = &surface->hooks;
    dgfemi_surface_build build;
    size_t vertices;
    memset(&build, 0, sizeof build);
    build.mesh = body->mesh, build.corners = corners;
    if (!dgfemi_surface_allocate(&build, arena)) return 0;
    dgfemi_surface_add_sides(&build);
    surface->vertex_count = dgfemi_surface_number(&build);
    vertices = (size_t)surface->vertex_count;
    surface->positions = (dgfem_vec3 *)dgfemi_allocate(hooks, vertices, sizeof(dgfem_vec3));
    surface->normals = (dgfem_vec3 *)dgfemi_allocate(hooks, vertices, sizeof(dgfem_vec3));
    surface->embedding = dgfemi_embedding_new(body, hooks);
    if (!surface->positions || !surface->normals || !surface->embedding) return 0;
    return dgfemi_surface_sample(&build, arena, body, surface) &&
           dgfemi_surface_add_triangles(&build, hooks, surface) &&
           dgfemi_list_corners(hooks, surface->triangles, surface->triangle_count, surface->vertex_count,
                               &surface->corner_start, &surface->corners);
}

static dgfem_status dgfemi_surface_create(const dgfem_body *body, dgfem_surface **out) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfem_corners *corners = NULL;
    dgfem_surface *surface;
    dgfem_status status = dgfem_mesh_corners(body->mesh, &corners);
    if (status != DGFEM_OK) return status;
    surface = (dgfem_surface *)dgfemi_allocate_zero(hooks, 1, sizeof *surface);
    if (surface) surface->hooks = *hooks;
    if (!surface || !dgfemi_surface_fill(&arena, body, corners, surface)) status = dgfemi_fail_memory(hooks);
    dgfemi_arena_free(&arena);
    dgfem_corners_destroy(corners);
    if (status != DGFEM_OK) {
        dgfem_surface_destroy(surface);
        return status;
    }
    dgfemi_surface_update(surface, body);
    *out = surface;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_surface_create(const dgfem_body *body, dgfem_surface **out) {
    if (out) *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "surface: no place for the result");
    return dgfemi_surface_create(body, out);
}

/* ---- results ---- */

DGFEM_API dgfem_status dgfem_surface_positions(const dgfem_surface *surface, dgfem_points_out out) {
    if (!surface) return DGFEM_ERROR_ARGUMENT;
    return dgfemi_write_points(&surface->hooks, surface->positions, surface->vertex_count, &out, "surface positions");
}

DGFEM_API dgfem_status dgfem_surface_normals(const dgfem_surface *surface, dgfem_points_out out) {
    if (!surface) return DGFEM_ERROR_ARGUMENT;
    return dgfemi_write_points(&surface->hooks, surface->normals, surface->vertex_count, &out, "surface normals");
}
