#pragma once
#include "parts.c"
#include "join.c"
#include "polyhedron.c"
/* Plane split, first half: the splitter, crossing vertices, cutting a face. split.c tells how all of it works. */

/* A vertex on the cut line of a face, and where along it. */
typedef struct dgfemi_crossing {
    dgfem_real t;
    int vertex;
} dgfemi_crossing;

typedef struct dgfemi_crossings {
    dgfemi_crossing *data;
    int count, capacity;
} dgfemi_crossings;

/* What became of a face that was cut: its parts are the faces first <= f < first + below + above. Where the part below
   is one with a single edge in the plane, that edge is p -> q; else p is DGFEM_NONE. */
typedef struct dgfemi_cut_face {
    unsigned generation;
    int first, below, above;
    int p, q;
} dgfemi_cut_face;

/* An element to come. */
typedef struct dgfemi_split_child {
    int parent;
    int side;                   /* -1 below, +1 above; 0: no child but the parent, outside the split, with new faces */
    int face_start, face_count; /* range of splitter.child_faces */
    int cap_start, cap_end;     /* the mesh's faces that are the parent's caps */
    int element;                /* index, once committed */
} dgfemi_split_child;

/* A face outside the split that gets new loops because its edges were split. */
typedef struct dgfemi_split_reloop {
    int face, loop_start;
} dgfemi_split_reloop;

/* Planes that new vertices are to lie on exactly when they are within `noise` of them: the grid of the slicer. */
typedef struct dgfemi_lattice {
    dgfem_real lower[3], cell[3];
    int cells[3];
    dgfem_real noise;
} dgfemi_lattice;

/* The faces at each vertex, as lists that new faces are added to; dead faces stay in them. */
typedef struct dgfemi_incidence {
    int *head;           /* [vertex_count] first entry, or DGFEM_NONE */
    dgfemi_ints entries; /* pairs: face, next entry */
    int vertex_count, head_capacity;
    int face_count; /* faces entered */
} dgfemi_incidence;

/* One splitter serves many planes: what it allocates is kept. */
typedef struct dgfemi_splitter {
    dgfem_mesh *mesh;

    /* options */
    dgfem_real snap;               /* as in dgfem_mesh_split_plane; not for axis planes */
    int components;                /* 1: every component of a part becomes an element of its own */
    int all;                       /* 1: all elements that straddle the plane are given, so that none outside shares an
                                      edge that is split */
    int measure;                   /* 1: new faces and elements are measured */
    const dgfemi_lattice *lattice; /* or NULL */
    int local; /* 1: a plane concerns the given elements only; all that a split costs is near them */

    /* the plane */
    dgfem_vec3 normal;    /* unit */
    int axis;             /* 0..2: the plane is a coordinate plane; DGFEM_NONE: any plane */
    dgfem_real *height;   /* [vertex_count] axis: the coordinate; any plane: distance times the length of its normal */
    dgfem_real low, high; /* vertices below have height < low, vertices above height > high; equal for an axis */
    dgfem_plane plane;    /* not for an axis */
    int snapped;          /* 1: some vertex counts as on the plane that is off it by more than round-off */
    signed char *snap_mark; /* [vertex_count] 1: to be snapped; -1: must not be */
    dgfem_real *extent; /* [2 * face_count] axis: the face's lowest and highest coordinate; not known when reversed */
    int height_capacity, snap_mark_capacity, extent_capacity, extent_count;
    dgfemi_ints selected; /* elements that straddle the plane */

    /* one call */
    int vertex_count, face_count, loop_count, loop_vertex_count; /* of the mesh at its start */
    unsigned generation;                                         /* of valid marks */
    dgfemi_edge_map crossings;                                   /* edge -> crossing vertex */
    dgfemi_cut_face *cut;                                        /* [face_count] */
    unsigned *element_mark;                                      /* [element_count] given or renewed */
    int cut_capacity, element_mark_capacity;
    dgfemi_ints cut_faces;
    int failed_element; /* on failure: the last one tried */
    dgfemi_split_child *children;
    dgfemi_ints child_faces; /* codes */
    dgfemi_split_reloop *reloops;
    int child_count, child_capacity, reloop_count, reloop_capacity;
    dgfemi_incidence incidence; /* local */
    dgfemi_ints crossed;        /* local: the edges split, as pairs of vertices */

    /* one element: codes as in parts.c */
    dgfemi_ints below, above;
    dgfemi_ints touching; /* those below that may have unknown edges in the plane */
    dgfemi_segments caps; /* known edges of the caps */
    int coplanar;         /* 1: some face has all its vertices on the plane */
    dgfemi_parts parts;

    /* one face */
    dgfemi_segments pieces, lines;
    dgfemi_crossings ups, downs, ons;
    int along_axis, along_back;
    dgfemi_ints scratch_a, scratch_b;
    dgfemi_joiner joiner;
} dgfemi_splitter;

static void dgfemi_splitter_attach(dgfemi_splitter *s, dgfem_mesh *mesh) {
    s->mesh = mesh;
    s->parts.mesh = mesh;
    s->joiner.mesh = mesh;
}

static dgfemi_splitter dgfemi_splitter_make(dgfem_mesh *mesh) {
    dgfemi_splitter s;
    memset(&s, 0, sizeof s);
    s.axis = DGFEM_NONE;
    dgfemi_splitter_attach(&s, mesh);
    return s;
}

static void dgfemi_splitter_free(dgfemi_splitter *s) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfemi_free(hooks, s->height);
    dgfemi_free(hooks, s->snap_mark);
    dgfemi_free(hooks, s->extent);
    dgfemi_free(hooks, s->selected.data);
    dgfemi_free(hooks, s->crossings.slots);
    dgfemi_free(hooks, s->cut);
    dgfemi_free(hooks, s->element_mark);
    dgfemi_free(hooks, s->cut_faces.data);
    dgfemi_free(hooks, s->children);
    dgfemi_free(hooks, s->child_faces.data);
    dgfemi_free(hooks, s->reloops);
    dgfemi_free(hooks, s->incidence.head);
    dgfemi_free(hooks, s->incidence.entries.data);
    dgfemi_free(hooks, s->crossed.data);
    dgfemi_free(hooks, s->below.data);
    dgfemi_free(hooks, s->above.data);
    dgfemi_free(hooks, s->touching.data);
    dgfemi_free(hooks, s->caps.data);
    dgfemi_free(hooks, s->pieces.data);
    dgfemi_free(hooks, s->lines.data);
    dgfemi_free(hooks, s->ups.data);
    dgfemi_free(hooks, s->downs.data);
    dgfemi_free(hooks, s->ons.data);
    dgfemi_free(hooks, s->scratch_a.data);
    dgfemi_free(hooks, s->scratch_b.data);
    dgfemi_parts_free(&s->parts);
    dgfemi_joiner_free(&s->joiner);
}

/* Room for so many more items. 1 on success, 0 when out of memory. */
static int dgfemi_split_room(const dgfem_hooks *hooks, dgfemi_ints *ints, int extra) {
    void *data = ints->data;
    int ok = dgfemi_mesh_room(hooks, &data, ints->count, &ints->capacity, extra, sizeof(int));
    ints->data = (int *)data;
    return ok;
}

static int dgfemi_crossing_push(const dgfem_hooks *hooks, dgfemi_crossings *crossings, dgfem_real t, int vertex) {
    if (crossings->count == crossings->capacity) {
        void *grown =
            dgfemi_grow(hooks, crossings->data, &crossings->capacity, crossings->count + 1, sizeof(dgfemi_crossing));
        if (!grown) return 0;
        crossings->data = (dgfemi_crossing *)grown;
    }
    crossings->data[crossings->count].t = t;
    crossings->data[crossings->count++].vertex = vertex;
    return 1;
}

/* ---- the faces at a vertex ---- */

/* Enters a face at its vertices, from a vertex on. */
static int dgfemi_incidence_enter(const dgfem_mesh *mesh, dgfemi_incidence *incidence, int face, int first_vertex) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++) {
            int v = mesh->loop_vertices[mesh->loops[l].start + i], *head = &incidence->head[v];
            int entry = incidence->entries.count;
            if (v < first_vertex) continue;
            if (!dgfemi_push(&mesh->hooks, &incidence->entries, face) ||
                !dgfemi_push(&mesh->hooks, &incidence->entries, *head))
                return 0;
            *head = entry;
        }
    return 1;
}

/* Enters what the mesh has gained since the last call. 1 on success, 0 when out of memory. */
static int dgfemi_incidence_grow(const dgfem_mesh *mesh, dgfemi_incidence *incidence) {
    void *head = incidence->head;
    int ok = dgfemi_mesh_room(&mesh->hooks, &head, 0, &incidence->head_capacity, mesh->vertex_count, sizeof(int));
    incidence->head = (int *)head;
    if (!ok) return 0;
    for (; incidence->vertex_count < mesh->vertex_count; incidence->vertex_count++)
        incidence->head[incidence->vertex_count] = DGFEM_NONE;
    for (; ok && incidence->face_count < mesh->face_count; incidence->face_count++)
        if (mesh->faces[incidence->face_count].element[0] != DGFEM_NONE)
            ok = dgfemi_incidence_enter(mesh, incidence, incidence->face_count, 0);
    return ok;
}

/* ---- vertices ---- */

/* -1 below, 0 on, +1 above the plane. */
static int dgfemi_split_sign(const dgfemi_splitter *s, int vertex) {
    dgfem_real height = s->height[vertex];
    return (height > s->high) - (height < s->low);
}

/* Appends a vertex that is on the plane; DGFEM_NONE when out of memory. */
static int dgfemi_split_add_vertex(dgfemi_splitter *s, dgfem_vec3 p) {
    int vertex = dgfemi_mesh_add_vertex(s->mesh, p);
    if (vertex == DGFEM_NONE) return DGFEM_NONE;
    if (vertex >= s->height_capacity) {
        void *grown = dgfemi_grow(&s->mesh->hooks, s->height, &s->height_capacity, vertex + 1, sizeof(dgfem_real));
        if (!grown) return DGFEM_NONE;
        s->height = (dgfem_real *)grown;
    }
    s->height[vertex] = s->axis == DGFEM_NONE ? 0 : s->low;
    return vertex;
}

static dgfem_real *dgfemi_axis_of(dgfem_vec3 *p, int axis) { return axis == 0 ? &p->x : axis == 1 ? &p->y : &p->z; }

static dgfem_real dgfemi_lattice_plane(const dgfemi_lattice *lattice, int axis, int index) {
    return lattice->lower[axis] + (dgfem_real)index * lattice->cell[axis];
}

/* Moves the coordinates that only round-off keeps off an inner plane of the lattice onto it. */
static void dgfemi_lattice_snap(const dgfemi_lattice *lattice, dgfem_vec3 *p) {
    int axis;
    for (axis = 0; axis < 3; axis++) {
        dgfem_real *x = dgfemi_axis_of(p, axis);
        dgfem_real index = (*x - lattice->lower[axis]) / lattice->cell[axis] + DGFEM_R(0.5);
        if (index >= 1 && index < (dgfem_real)lattice->cells[axis]) {
            dgfem_real plane = dgfemi_lattice_plane(lattice, axis, (int)index);
            if (dgfemi_abs(*x - plane) <= lattice->noise) *x = plane;
        }
    }
}

/* Where the edge from a to b meets the plane; never outside the edge's box. */
static dgfem_vec3 dgfemi_split_interpolate(const dgfemi_splitter *s, int a, int b) {
    dgfem_vec3 pa = s->mesh->vertices[a], pb = s->mesh->vertices[b], p;
    dgfem_real height = s->axis == DGFEM_NONE ? 0 : s->low;
    p = dgfemi_add_scaled(pa, (height - s->height[a]) / (s->height[b] - s->height[a]), dgfemi_sub(pb, pa));
    return dgfemi_max3(dgfemi_min3(p, dgfemi_max3(pa, pb)), dgfemi_min3(pa, pb));
}

/* The vertex where the plane crosses an edge from below to above or back; DGFEM_NONE when out of memory. */
static int dgfemi_split_crossing(dgfemi_splitter *s, int a, int b) {
    dgfemi_edge_slot *slot = dgfemi_edge_map_at(&s->crossings, a, b);
    dgfem_vec3 p;
    int vertex;
    if (dgfemi_edge_map_has(&s->crossings, slot)) return slot->value;
    p = a < b ? dgfemi_split_interpolate(s, a, b) : dgfemi_split_interpolate(s, b, a);
    if (s->axis != DGFEM_NONE) *dgfemi_axis_of(&p, s->axis) = s->low;
    if (s->lattice) dgfemi_lattice_snap(s->lattice, &p);
    vertex = dgfemi_split_add_vertex(s, p);
    if (vertex == DGFEM_NONE) return DGFEM_NONE;
    if (s->local && (!dgfemi_push(&s->mesh->hooks, &s->crossed, a) || !dgfemi_push(&s->mesh->hooks, &s->crossed, b)))
        return DGFEM_NONE;
    return dgfemi_edge_map_set(&s->mesh->hooks, &s->crossings, slot, a, b, vertex) ? vertex : DGFEM_NONE;
}

/* ---- new faces from segments ---- */

/* Appends a face of the last loops; all but its normal it inherits from `like`. 1 on success, 0 when out of memory. */
static int dgfemi_split_add_face(dgfem_mesh *mesh, const dgfem_face *like, int loops, dgfem_vec3 normal) {
    int face = dgfemi_mesh_add_face(mesh, mesh->loop_count - loops, loops, like->element[0], like->element[1],
                                    like->tag, normal);
    if (face != DGFEM_NONE) mesh->faces[face].cut = like->cut;
    return face != DGFEM_NONE;
}

/* 1 when the last loops have a vertex that was snapped. */
static int dgfemi_split_is_bent(const dgfemi_splitter *s, int loops) {
    const dgfem_mesh *mesh = s->mesh;
    int i;
    if (!s->snapped) return 0;
    for (i = mesh->loops[mesh->loop_count - loops].start; i < mesh->loop_vertex_count; i++) {
        int v = mesh->loop_vertices[i];
        dgfem_real distance = dgfemi_dot(s->plane.normal, mesh->vertices[v]) - s->plane.offset;
        if (v < s->vertex_count && dgfemi_abs(distance) > s->high) return 1;
    }
    return 0;
}

/* The middle of a region that snapping has bent, moved onto the plane. */
static dgfem_vec3 dgfemi_split_bent_centre(const dgfemi_splitter *s, const int *loop, int count) {
    const dgfem_vec3 *vertices = s->mesh->vertices;
    dgfem_vec3 origin = vertices[loop[0]], moment = dgfemi_vec3(0, 0, 0), centre, n = s->plane.normal;
    dgfem_real twice = 0;
    int i;
    for (i = 2; i < count; i++) {
        dgfem_vec3 a = dgfemi_sub(vertices[loop[i - 1]], origin), b = dgfemi_sub(vertices[loop[i]], origin);
        dgfem_real area = dgfemi_dot(s->normal, dgfemi_cross(a, b));
        twice += area;
        moment = dgfemi_add_scaled(moment, area, dgfemi_add(a, b));
    }
    centre = dgfemi_add_scaled(origin, 1 / (3 * twice), moment);
    return dgfemi_add_scaled(centre, (s->plane.offset - dgfemi_dot(n, centre)) / dgfemi_dot(n, n), n);
}

/* A triangle of a bent region must have this fraction of the area that it would have if all were alike, */
#define DGFEM_BENT_AREA DGFEM_R(1e-3)
/* and this cosine to the plane's normal: snapping is to change the plane a little. */
#define DGFEM_BENT_COSINE DGFEM_R(0.8)

/* A region that snapping has bent becomes triangles around its middle, each in its own plane: exact integrals need
   planar faces. Refuses holes and regions whose middle does not see all of their boundary well. */
static dgfem_status dgfemi_split_add_bent(dgfemi_splitter *s, const dgfem_face *like, int loops) {
    dgfem_mesh *mesh = s->mesh;
    int count = mesh->loops[mesh->loop_count - 1].count, start = mesh->loops[mesh->loop_count - 1].start, centre, i;
    dgfem_real whole;
    if (loops > 1) return DGFEM_ERROR_DEGENERATE;
    s->scratch_a.count = 0;
    for (i = 0; i < count; i++)
        if (!dgfemi_push(&mesh->hooks, &s->scratch_a, mesh->loop_vertices[start + i])) return DGFEM_ERROR_MEMORY;
    mesh->loop_count--, mesh->loop_vertex_count = start;
    centre = dgfemi_split_add_vertex(s, dgfemi_split_bent_centre(s, s->scratch_a.data, count));
    if (centre == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    for (i = 0, whole = 0; i < 2 * count; i++) { /* the areas, then the faces */
        int triangle[3];
        dgfem_vec3 p = mesh->vertices[centre], a, b, area;
        dgfem_real flat;
        triangle[0] = centre, triangle[1] = s->scratch_a.data[i % count],
        triangle[2] = s->scratch_a.data[(i + 1) % count];
        a = dgfemi_sub(mesh->vertices[triangle[1]], p), b = dgfemi_sub(mesh->vertices[triangle[2]], p);
        area = dgfemi_cross(a, b), flat = dgfemi_dot(area, s->normal);
        if (i < count) {
            whole += flat;
            continue;
        }
        if (!(flat > DGFEM_BENT_AREA * whole / (dgfem_real)count) || !(flat > DGFEM_BENT_COSINE * dgfemi_norm(area)))
            return DGFEM_ERROR_DEGENERATE;
        if (dgfemi_mesh_add_loop(mesh, triangle, 3) == DGFEM_NONE ||
            !dgfemi_split_add_face(mesh, like, 1, dgfemi_normalized(area)))
            return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* One face for the region of the joined loop `outer`. */
static dgfem_status dgfemi_split_add_region(dgfemi_splitter *s, const dgfem_face *like, int outer) {
    const dgfemi_joiner *joiner = &s->joiner;
    int is_cap = like->element[0] == like->element[1], loops = 0, loop;
    for (loop = 0; loop < dgfemi_join_loop_count(joiner); loop++) {
        int start = joiner->start.data[loop], count = joiner->start.data[loop + 1] - start;
        if (joiner->owner.data[loop] != outer) continue;
        if (dgfemi_mesh_add_loop(s->mesh, joiner->vertices.data + start, count) == DGFEM_NONE)
            return DGFEM_ERROR_MEMORY;
        loops++;
    }
    if (is_cap && dgfemi_split_is_bent(s, loops)) return dgfemi_split_add_bent(s, like, loops);
    return dgfemi_split_add_face(s->mesh, like, loops, like->normal) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Joins the segments into faces that inherit from `like`. *first, *count: the new ones. */
static dgfem_status dgfemi_split_add_faces(dgfemi_splitter *s, dgfemi_segments *segments, const dgfem_face *like,
                                           int *first, int *count) {
    dgfem_status status;
    int loop;
    *first = s->mesh->face_count;
    dgfemi_projection_axes(like->normal, &s->joiner.axis_u, &s->joiner.axis_v);
    status = dgfemi_join_loops(&s->joiner, segments);
    if (!status) status = dgfemi_join_regions(&s->joiner);
    for (loop = 0; !status && loop < dgfemi_join_loop_count(&s->joiner); loop++)
        if (s->joiner.owner.data[loop] == loop) status = dgfemi_split_add_region(s, like, loop);
    *count = s->mesh->face_count - *first;
    return status;
}

/* ---- cutting a face ---- */

typedef struct dgfemi_face_signs {
    int below, on, above; /* numbers of vertices, or 1 for any */
    int simple;           /* one loop that passes the plane once up and once down, with no other vertex on it */
} dgfemi_face_signs;

static dgfemi_face_signs dgfemi_split_count_signs(const dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    dgfemi_face_signs signs = {0, 0, 0, 0};
    int l, i, ups = 0, touches = 0;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, last = dgfemi_split_sign(s, loop[count - 1]);
        for (i = 0; i < count; i++) {
            int sign = dgfemi_split_sign(s, loop[i]);
            signs.below += sign < 0;
            signs.above += sign > 0;
            if (sign == 0) {
                signs.on++;
                touches |= last * dgfemi_split_sign(s, loop[i + 1 < count ? i + 1 : 0]) != -1;
            }
            ups += last < 0 && sign >= 0;
            last = sign;
        }
    }
    signs.simple = face->loop_count == 1 && ups == 1 && !touches;
    return signs;
}

static void dgfemi_split_measure_extent(dgfemi_splitter *s, int f) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *face = &mesh->faces[f];
    dgfem_real low = s->height[mesh->loop_vertices[mesh->loops[face->loop_start].start]], high = low;
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        for (i = 0; i < mesh->loops[l].count; i++) {
            low = dgfemi_min(low, s->height[loop[i]]);
            high = dgfemi_max(high, s->height[loop[i]]);
        }
    }
    s->extent[2 * f] = low, s->extent[2 * f + 1] = high;
}

/* Where many axis planes follow each other, most faces are told by their extents. */
static dgfemi_face_signs dgfemi_split_face_signs(dgfemi_splitter *s, int f) {
    dgfemi_face_signs below = {1, 0, 0, 0}, above = {0, 0, 1, 0};
    if (s->axis != DGFEM_NONE) {
        if (s->extent[2 * f] > s->extent[2 * f + 1]) dgfemi_split_measure_extent(s, f);
        if (s->extent[2 * f + 1] < s->low) return below;
        if (s->extent[2 * f] > s->high) return above;
    }
    return dgfemi_split_count_signs(s, &s->mesh->faces[f]);
}

static int dgfemi_split_add_piece(dgfem_mesh *mesh, const dgfem_face *like, const dgfemi_ints *loop) {
    return dgfemi_mesh_add_loop(mesh, loop->data, loop->count) != DGFEM_NONE &&
           dgfemi_split_add_face(mesh, like, 1, like->normal);
}

/* Fills s->scratch_a with the vertices below, s->scratch_b with those above, both in the order of the loop; *p, *q:
   where it goes up and down. 1 on success, 0 when out of memory. */
static int dgfemi_split_part_loop(dgfemi_splitter *s, dgfem_loop loop, int *p, int *q) {
    const dgfem_mesh *mesh = s->mesh;
    int first = 0, i, last, last_sign;
    s->scratch_a.count = s->scratch_b.count = 0;
    if (!dgfemi_split_room(&mesh->hooks, &s->scratch_a, loop.count + 2) ||
        !dgfemi_split_room(&mesh->hooks, &s->scratch_b, loop.count + 2))
        return 0;
    while (dgfemi_split_sign(s, mesh->loop_vertices[loop.start + first]) < 0) first++;
    while (dgfemi_split_sign(s, mesh->loop_vertices[loop.start + first]) >= 0) first = (first + 1) % loop.count;
    last = mesh->loop_vertices[loop.start + (first + loop.count - 1) % loop.count]; /* the last one not below */
    last_sign = dgfemi_split_sign(s, last);
    *q = last;
    for (i = 0; i < loop.count; i++) {
        int vertex = mesh->loop_vertices[loop.start + (first + i) % loop.count], sign = dgfemi_split_sign(s, vertex);
        if (last_sign * sign < 0) {
            int crossing = dgfemi_split_crossing(s, last, vertex);
            if (crossing == DGFEM_NONE) return 0;
            *(sign < 0 ? q : p) = crossing;
        } else if (last_sign < 0 && sign == 0) {
            *p = vertex;
        }
        if (sign < 0) s->scratch_a.data[s->scratch_a.count++] = vertex;
        if (sign > 0) s->scratch_b.data[s->scratch_b.count++] = vertex;
        last = vertex, last_sign = sign;
    }
    return 1;
}

/* 1 when the element has an edge between two vertices. */
static int dgfemi_split_has_edge(const dgfemi_splitter *s, int element, int a, int b) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++) {
                int from = loop[i], to = loop[i + 1 < count ? i + 1 : 0];
                if ((from == a && to == b) || (from == b && to == a)) return 1;
            }
        }
    }
    return 0;
}

/* 1 when some other edge joins two vertices of a face already. That takes faces which touch along it; a cut line must
   not be taken for that edge. */
static int dgfemi_split_is_taken(const dgfemi_splitter *s, const dgfem_face *face, int from, int to) {
    if (from >= s->vertex_count || to >= s->vertex_count) return 0;
    return dgfemi_split_has_edge(s, face->element[0], from, to) ||
           (face->element[1] != DGFEM_NONE && dgfemi_split_has_edge(s, face->element[1], from, to));
}

/* A face with simple signs. Leaves cut->below at 0 where it is not so simple after all. */
static dgfem_status dgfemi_split_cut_simple(dgfemi_splitter *s, const dgfem_face *face, dgfemi_cut_face *cut) {
    dgfem_mesh *mesh = s->mesh;
    if (!dgfemi_split_part_loop(s, mesh->loops[face->loop_start], &cut->p, &cut->q)) return DGFEM_ERROR_MEMORY;
    if (cut->p == cut->q || dgfemi_split_is_taken(s, face, cut->p, cut->q)) return DGFEM_OK;
    s->scratch_a.data[s->scratch_a.count++] = cut->p;
    s->scratch_a.data[s->scratch_a.count++] = cut->q;
    s->scratch_b.data[s->scratch_b.count++] = cut->q;
    s->scratch_b.data[s->scratch_b.count++] = cut->p;
    cut->first = mesh->face_count;
    cut->below = cut->above = 1;
    if (!dgfemi_split_add_piece(mesh, face, &s->scratch_a) || !dgfemi_split_add_piece(mesh, face, &s->scratch_b))
        return DGFEM_ERROR_MEMORY;
    return DGFEM_OK;
}

static int dgfemi_crossing_compare(const void *a, const void *b) {
    const dgfemi_crossing *x = (const dgfemi_crossing *)a, *y = (const dgfemi_crossing *)b;
    if (x->t < y->t) return -1;
    if (x->t > y->t) return 1;
    return (x->vertex > y->vertex) - (x->vertex < y->vertex);
}

static void dgfemi_crossings_sort(dgfemi_crossings *crossings) {
    if (crossings->count > 1)
        qsort(crossings->data, (size_t)crossings->count, sizeof(dgfemi_crossing), dgfemi_crossing_compare);
}

/* Where a vertex is along the cut line of the face at hand, in the direction in which that line closes the part below.
   As a coordinate: nothing is rounded. */
static dgfem_real dgfemi_split_along(const dgfemi_splitter *s, int vertex) {
    dgfem_real t = dgfemi_axis(s->mesh->vertices[vertex], s->along_axis);
    return s->along_back ? -t : t;
}

static void dgfemi_split_set_along(dgfemi_splitter *s, dgfem_vec3 face_normal) {
    dgfem_vec3 along = dgfemi_cross(face_normal, s->normal);
    dgfem_real x = dgfemi_abs(along.x), y = dgfemi_abs(along.y), z = dgfemi_abs(along.z);
    s->along_axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    s->along_back = dgfemi_axis(along, s->along_axis) < 0;
}

/* On which side of the plane the face is at its edge a -> b, which does not cross the plane. An edge in the plane has
   the face on its left: below when it runs along the cut line. */
static int dgfemi_split_edge_side(const dgfemi_splitter *s, int a, int b) {
    int side = dgfemi_split_sign(s, a) + dgfemi_split_sign(s, b);
    return side != 0 ? side : dgfemi_split_along(s, b) > dgfemi_split_along(s, a) ? -1 : 1;
}

/* Lists what a vertex b contributes, between its neighbours a and c: where the loop passes to the other side, on edge
   a -> b or at b; and b as a vertex on the plane where the loop only touches it. */
static int dgfemi_split_list_vertex(dgfemi_splitter *s, int a, int b, int c) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int sign_a = dgfemi_split_sign(s, a), sign_b = dgfemi_split_sign(s, b), from = sign_a;
    if (sign_b == 0) {
        from = dgfemi_split_edge_side(s, a, b);
        if ((from < 0) == (dgfemi_split_edge_side(s, b, c) < 0))
            return dgfemi_crossing_push(hooks, &s->ons, dgfemi_split_along(s, b), b);
    } else {
        if (sign_a * sign_b >= 0) return 1;
        b = dgfemi_split_crossing(s, a, b);
        if (b == DGFEM_NONE) return 0;
    }
    return dgfemi_crossing_push(hooks, from < 0 ? &s->ups : &s->downs, dgfemi_split_along(s, b), b);
}

/* Lists the crossings of a face, up and down, and the vertices that touch the plane, each sorted along the cut line. */
static dgfem_status dgfemi_split_list_crossings(dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    s->ups.count = s->downs.count = s->ons.count = 0;
    dgfemi_split_set_along(s, face->normal);
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        int start = mesh->loops[l].start, count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (!dgfemi_split_list_vertex(s, mesh->loop_vertices[start + (i + count - 1) % count],
                                          mesh->loop_vertices[start + i], mesh->loop_vertices[start + (i + 1) % count]))
                return DGFEM_ERROR_MEMORY;
    }
    DGFEM_ASSERT(s->ups.count == s->downs.count);
    dgfemi_crossings_sort(&s->ups);
    dgfemi_crossings_sort(&s->downs);
    dgfemi_crossings_sort(&s->ons);
    return DGFEM_OK;
}

/* Adds a segment; where there is an edge like it, with a vertex in the middle. 1 on success, 0 when out of memory. */
static int dgfemi_split_push_line(dgfemi_splitter *s, const dgfem_face *face, int from, int to) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int middle;
    if (!dgfemi_split_is_taken(s, face, from, to)) return dgfemi_segment_push(hooks, &s->lines, from, to);
    middle = dgfemi_split_add_vertex(
        s, dgfemi_scale(DGFEM_R(0.5), dgfemi_add(s->mesh->vertices[from], s->mesh->vertices[to])));
    return middle != DGFEM_NONE && dgfemi_segment_push(hooks, &s->lines, from, middle) &&
           dgfemi_segment_push(hooks, &s->lines, middle, to);
}

/* Fills s->lines with segments up -> down, broken at the vertices that touch them (one for each place):

         \      /
          \ w  /          w: the loop comes down from above to touch the line
       ----+-+-------                                                                                */
static dgfem_status dgfemi_split_list_lines(dgfemi_splitter *s, const dgfem_face *face) {
    int k, i, ons = s->ons.count;
    s->lines.count = 0;
    for (k = 0; k < s->ups.count; k++) {
        dgfemi_crossing last = s->ups.data[k], to = s->downs.data[k];
        int forward = last.t < to.t;
        for (i = 0; i < ons; i++) {
            dgfemi_crossing on = s->ons.data[forward ? i : ons - 1 - i];
            if (!(forward ? on.t > last.t && on.t < to.t : on.t < last.t && on.t > to.t)) continue;
            if (!dgfemi_split_push_line(s, face, last.vertex, on.vertex)) return DGFEM_ERROR_MEMORY;
            last = on;
        }
        if (last.vertex != to.vertex && !dgfemi_split_push_line(s, face, last.vertex, to.vertex))
            return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* Adds to s->pieces what edge a -> b has on one side. 1 on success, 0 when out of memory. */
static int dgfemi_split_clip_edge(dgfemi_splitter *s, int a, int b, int side) {
    int sign_a = dgfemi_split_sign(s, a), sign_b = dgfemi_split_sign(s, b);
    if (sign_a * sign_b < 0) {
        int crossing = dgfemi_split_crossing(s, a, b); /* exists */
        if (sign_a == side) b = crossing;
        else a = crossing;
    } else if ((dgfemi_split_edge_side(s, a, b) < 0) != (side < 0)) {
        return 1;
    }
    return dgfemi_segment_push(&s->mesh->hooks, &s->pieces, a, b);
}

/* Fills s->pieces with the face's edges on one side, clipped, and the lines that close them. */
static dgfem_status dgfemi_split_list_pieces(dgfemi_splitter *s, const dgfem_face *face, int side) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    s->pieces.count = 0;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        int start = mesh->loops[l].start, count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (!dgfemi_split_clip_edge(s, mesh->loop_vertices[start + i], mesh->loop_vertices[start + (i + 1) % count],
                                        side))
                return DGFEM_ERROR_MEMORY;
    }
    for (i = 0; i < s->lines.count; i++) {
        dgfemi_segment line = s->lines.data[i];
        if (!dgfemi_segment_push(&mesh->hooks, &s->pieces, side < 0 ? line.from : line.to,
                                 side < 0 ? line.to : line.from))
            return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* Any number of loops and crossings. */
static dgfem_status dgfemi_split_cut_general(dgfemi_splitter *s, const dgfem_face *face, dgfemi_cut_face *cut) {
    dgfem_status status = dgfemi_split_list_crossings(s, face);
    int first_above;
    cut->p = cut->q = DGFEM_NONE;
    if (!status) status = dgfemi_split_list_lines(s, face);
    if (!status) status = dgfemi_split_list_pieces(s, face, -1);
    if (!status) status = dgfemi_split_add_faces(s, &s->pieces, face, &cut->first, &cut->below);
    if (!status) status = dgfemi_split_list_pieces(s, face, 1);
    if (!status) status = dgfemi_split_add_faces(s, &s->pieces, face, &first_above, &cut->above);
    return status;
}

/* Cuts a face that has vertices below and above; the second of its elements finds what the first one did. */
static dgfem_status dgfemi_split_cut_face(dgfemi_splitter *s, int f, int simple, dgfemi_cut_face *cut) {
    dgfem_face face = s->mesh->faces[f]; /* a copy: faces move */
    dgfem_status status = DGFEM_OK;
    if (s->cut[f].generation == s->generation) {
        *cut = s->cut[f];
        return DGFEM_OK;
    }
    memset(cut, 0, sizeof *cut);
    cut->generation = s->generation;
    if (simple) status = dgfemi_split_cut_simple(s, &face, cut);
    if (!status && cut->below == 0) status = dgfemi_split_cut_general(s, &face, cut);
    s->cut[f] = *cut;
    if (!status && !dgfemi_push(&s->mesh->hooks, &s->cut_faces, f)) status = DGFEM_ERROR_MEMORY;
    return status;
}
