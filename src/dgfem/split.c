#pragma once
#include "parts.c"
#include "join.c"
#include "mesh_build.c"
#include "polyhedron.c"
/* Plane split of elements of the cell complex; the stand-alone polyhedron is split as a complex of one element.

   Logic and geometry are kept apart. Each vertex is below, on or above the plane, decided once, and all else follows
   from these signs by counting: the parts close whatever round-off does to positions.

   - "On" counts as above, as if the plane lay a hair lower, but the crossing of an edge from below to a vertex on the
     plane is that vertex itself. What would be a part without thickness goes to the other side: a face in the plane
     belongs to the side that its element's interior is on.
   - A crossing vertex is made once per edge, interpolated from the edge's lower index, and found again by hash.
   - A face with vertices below and above is cut along segments between its crossings. Along the cut line, upward and
     downward crossings are as many as each other; the k-th of the ones is joined to the k-th of the others:

             d1        u1     d2       u2       counter-clockwise, d = down, u = up:
          ----+--------+------+--------+----    u1 -> d1, u2 -> d2 close the part below,
               \ below/        \ below/         the same ones reversed close the part above

   - The edges in the plane that the part below is left with close into loops, which bound the new faces (caps) between
     below and above. A cap of several loops is split into regions, so that islands stay separate.

   All this appends to the mesh; only the commit at the end, which cannot fail, changes what was there. */

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

    /* the plane */
    dgfem_vec3 normal;    /* unit */
    int axis;             /* 0..2: the plane is a coordinate plane; DGFEM_NONE: any plane */
    dgfem_real *height;   /* [vertex_count] axis: the coordinate; any plane: distance times the length of its normal */
    dgfem_real low, high; /* vertices below have height < low, vertices above height > high; equal for an axis */
    dgfem_plane plane;    /* not for an axis */
    int snapped;          /* 1: some vertex counts as on the plane that is off it by more than round-off */
    signed char *snap_mark; /* [vertex_count] 1: to be snapped; -1: must not be */
    dgfem_real *extent;   /* [2 * face_count] axis: the face's lowest and highest coordinate; not known when reversed */
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
    int failed_element;                                          /* on failure: the last one tried */
    dgfemi_split_child *children;
    dgfemi_ints child_faces;                                     /* codes */
    dgfemi_split_reloop *reloops;
    int child_count, child_capacity, reloop_count, reloop_capacity;

    /* one element: codes as in parts.c */
    dgfemi_ints below, above;
    dgfemi_ints touching;   /* those below that may have unknown edges in the plane */
    dgfemi_segments caps;   /* known edges of the caps */
    int coplanar;           /* 1: some face has all its vertices on the plane */
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
        void *grown = dgfemi_grow(hooks, crossings->data, &crossings->capacity, crossings->count + 1,
                                  sizeof(dgfemi_crossing));
        if (!grown) return 0;
        crossings->data = (dgfemi_crossing *)grown;
    }
    crossings->data[crossings->count].t = t;
    crossings->data[crossings->count++].vertex = vertex;
    return 1;
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

/* A triangle of a bent region must keep this fraction of the area that it would have if all were alike. */
#define DGFEM_BENT_AREA DGFEM_R(1e-3)

/* A region that snapping has bent becomes triangles around its middle, each in its own plane: exact integrals need
   planar faces. Refuses holes and regions whose middle does not see all of their boundary. */
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
        triangle[0] = centre, triangle[1] = s->scratch_a.data[i % count], triangle[2] = s->scratch_a.data[(i + 1) % count];
        a = dgfemi_sub(mesh->vertices[triangle[1]], p), b = dgfemi_sub(mesh->vertices[triangle[2]], p);
        area = dgfemi_cross(a, b);
        if (i < count) {
            whole += dgfemi_dot(area, s->normal);
            continue;
        }
        if (!(dgfemi_dot(area, s->normal) > DGFEM_BENT_AREA * whole / (dgfem_real)count)) return DGFEM_ERROR_DEGENERATE;
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
        if (dgfemi_mesh_add_loop(s->mesh, joiner->vertices.data + start, count) == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
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
    middle = dgfemi_split_add_vertex(s, dgfemi_scale(DGFEM_R(0.5), dgfemi_add(s->mesh->vertices[from],
                                                                             s->mesh->vertices[to])));
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

/* ---- cutting an element ---- */

/* A face that is not cut goes where its vertices are; one in the plane, to the side of the element's interior. */
static dgfem_status dgfemi_split_sort_whole(dgfemi_splitter *s, int code, const dgfemi_face_signs *signs) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int below = signs->below > 0, ok;
    if (signs->below == 0 && signs->above == 0) {
        dgfem_real up = dgfemi_dot(s->mesh->faces[code / 2].normal, s->normal);
        below = code % 2 ? up < 0 : up > 0;
        s->coplanar = 1;
    }
    ok = dgfemi_push(hooks, below ? &s->below : &s->above, code);
    if (ok && below && signs->on > 1) ok = dgfemi_push(hooks, &s->touching, code);
    return ok ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

static dgfem_status dgfemi_split_sort_cut(dgfemi_splitter *s, int code, const dgfemi_face_signs *signs) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfemi_cut_face cut;
    dgfem_status status = dgfemi_split_cut_face(s, code / 2, signs->simple, &cut);
    int i, ok = 1, inwards = code % 2, known = cut.p != DGFEM_NONE;
    if (status) return status;
    for (i = 0; ok && i < cut.below; i++) {
        ok = dgfemi_push(hooks, &s->below, 2 * (cut.first + i) + inwards);
        if (ok && !known) ok = dgfemi_push(hooks, &s->touching, 2 * (cut.first + i) + inwards);
    }
    for (i = 0; ok && i < cut.above; i++)
        ok = dgfemi_push(hooks, &s->above, 2 * (cut.first + cut.below + i) + inwards);
    if (ok && known) ok = dgfemi_segment_push(hooks, &s->caps, inwards ? cut.p : cut.q, inwards ? cut.q : cut.p);
    return ok ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Fills s->below, s->above, s->touching, s->caps. */
static dgfem_status dgfemi_split_sort_faces(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_element e = mesh->elements[element];
    dgfem_status status = DGFEM_OK;
    int k;
    s->below.count = s->above.count = s->touching.count = s->caps.count = 0;
    s->coplanar = 0;
    for (k = e.face_start; !status && k < e.face_start + e.face_count; k++) {
        int f = mesh->element_faces[k], code = 2 * f + (mesh->faces[f].element[0] != element);
        dgfemi_face_signs signs = dgfemi_split_face_signs(s, f);
        if (signs.below > 0 && signs.above > 0) status = dgfemi_split_sort_cut(s, code, &signs);
        else status = dgfemi_split_sort_whole(s, code, &signs);
    }
    return status;
}

/* Adds to s->pieces the edges in the plane of a face below, as the caps have them: reversed. */
static int dgfemi_split_list_touching(dgfemi_splitter *s, int code) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *face = &mesh->faces[code / 2];
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, a, b = loop[count - 1], on_a, on_b = dgfemi_split_sign(s, b) == 0;
        for (i = 0; i < count; i++) {
            a = b, on_a = on_b;
            b = loop[i], on_b = dgfemi_split_sign(s, b) == 0;
            if (on_a && on_b && !dgfemi_segment_push(&mesh->hooks, &s->pieces, code % 2 ? a : b, code % 2 ? b : a))
                return 0;
        }
    }
    return 1;
}

/* Closes both parts by caps, the faces *first <= f < *end. Until the commit they have the element on both sides. */
static dgfem_status dgfemi_split_add_caps(dgfemi_splitter *s, int element, int *first, int *end) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfem_status status = DGFEM_OK;
    dgfem_face like;
    int i, count = 0;
    memset(&like, 0, sizeof like);
    like.element[0] = like.element[1] = element;
    like.tag = DGFEM_NONE;
    like.normal = s->normal;
    s->pieces.count = 0;
    for (i = 0; i < s->caps.count; i++)
        if (!dgfemi_segment_push(hooks, &s->pieces, s->caps.data[i].from, s->caps.data[i].to)) return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->touching.count; i++)
        if (!dgfemi_split_list_touching(s, s->touching.data[i])) return DGFEM_ERROR_MEMORY;
    *first = s->mesh->face_count;
    if (s->pieces.count > 0) status = dgfemi_split_add_faces(s, &s->pieces, &like, first, &count);
    *end = *first + count;
    for (i = *first; !status && i < *end; i++)
        if (!dgfemi_push(hooks, &s->below, 2 * i) || !dgfemi_push(hooks, &s->above, 2 * i + 1))
            status = DGFEM_ERROR_MEMORY;
    return status;
}

/* ---- parts without thickness ---- */

/* 1 when some vertex of the face is off the plane. */
static int dgfemi_split_has_depth(const dgfemi_splitter *s, int face) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++)
            if (dgfemi_split_sign(s, mesh->loop_vertices[mesh->loops[l].start + i]) != 0) return 1;
    return 0;
}

static void dgfemi_split_remove(dgfemi_ints *codes, int code) {
    int i, kept = 0;
    for (i = 0; i < codes->count; i++)
        if (codes->data[i] != code) codes->data[kept++] = codes->data[i];
    codes->count = kept;
}

/* Moves the faces, all but caps, of components without thickness to the other side, and counts them. */
static dgfem_status dgfemi_split_move_flat(dgfemi_splitter *s, dgfemi_ints *from, dgfemi_ints *to, int first_cap,
                                           int *moved) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int k, i;
    *moved = 0;
    if (!dgfemi_parts_find(&s->parts, from)) return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->parts.count; i++) s->parts.parent[i] = 0; /* from here on: has thickness */
    for (k = 0; k < from->count; k++)
        if (dgfemi_split_has_depth(s, from->data[k] / 2)) s->parts.parent[s->parts.component[k]] = 1;
    s->scratch_a.count = 0;
    for (k = 0; k < from->count; k++)
        if (!s->parts.parent[s->parts.component[k]] && from->data[k] / 2 < first_cap &&
            !dgfemi_push(hooks, &s->scratch_a, from->data[k]))
            return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->scratch_a.count; i++) {
        int code = s->scratch_a.data[i];
        dgfemi_split_remove(from, code);
        dgfemi_split_remove(&s->touching, code);
        if (!dgfemi_push(hooks, to, code) || (to == &s->below && !dgfemi_push(hooks, &s->touching, code)))
            return DGFEM_ERROR_MEMORY;
    }
    *moved = s->scratch_a.count;
    return DGFEM_OK;
}

/* Caps; where they leave a part without thickness, caps again without it. Such a part comes from faces that are in the
   plane but for round-off or snapping, and it is anyone's guess on which side they are. */
static dgfem_status dgfemi_split_close(dgfemi_splitter *s, int element, int *first_cap, int *end_cap) {
    dgfem_mesh *mesh = s->mesh;
    int attempt, moved, loops = mesh->loop_count, loop_vertices = mesh->loop_vertex_count;
    for (attempt = 0; attempt < 4; attempt++) {
        dgfem_status status = dgfemi_split_add_caps(s, element, first_cap, end_cap);
        if (status || !s->coplanar) return status;
        status = dgfemi_split_move_flat(s, &s->below, &s->above, *first_cap, &moved);
        if (!status && !moved) status = dgfemi_split_move_flat(s, &s->above, &s->below, *first_cap, &moved);
        if (status || !moved) return status;
        for (; *end_cap > *first_cap; --*end_cap) {
            dgfemi_split_remove(&s->below, 2 * (*end_cap - 1));
            dgfemi_split_remove(&s->above, 2 * (*end_cap - 1) + 1);
        }
        mesh->face_count = *first_cap, mesh->loop_count = loops, mesh->loop_vertex_count = loop_vertices;
    }
    return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_DEGENERATE, "element %d: a part of it lies in the plane", element);
}

/* ---- children ---- */

/* Adds the faces of one component, or all for DGFEM_NONE, as an element to come. */
static dgfem_status dgfemi_split_add_child(dgfemi_splitter *s, const dgfemi_ints *codes, int component,
                                           dgfemi_split_child child) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int k;
    if (s->child_count == s->child_capacity) {
        void *grown = dgfemi_grow(hooks, s->children, &s->child_capacity, s->child_count + 1, sizeof(child));
        if (!grown) return DGFEM_ERROR_MEMORY;
        s->children = (dgfemi_split_child *)grown;
    }
    if (!dgfemi_split_room(hooks, &s->child_faces, codes->count)) return DGFEM_ERROR_MEMORY;
    child.face_start = s->child_faces.count;
    for (k = 0; k < codes->count; k++)
        if (component == DGFEM_NONE || s->parts.component[k] == component)
            s->child_faces.data[s->child_faces.count++] = codes->data[k];
    child.face_count = s->child_faces.count - child.face_start;
    s->children[s->child_count++] = child;
    return DGFEM_OK;
}

/* Refuses parts without volume. Negative is a void, but only where there is no cap: beyond a cap is the outside. */
static dgfem_status dgfemi_split_check_volumes(const dgfemi_splitter *s, const dgfemi_split_child *child) {
    const dgfemi_parts *parts = &s->parts;
    int k;
    for (k = 0; k < parts->code_count; k++) {
        int face = parts->codes[k] / 2, is_cap = face >= child->cap_start && face < child->cap_end;
        dgfem_real volume = parts->volume[parts->component[k]];
        if (!(volume > 0) && !(volume < 0 && !is_cap))
            return dgfemi_fail(&s->mesh->hooks, DGFEM_ERROR_DEGENERATE,
                               "element %d: the plane leaves a part of volume %g", child->parent, (double)volume);
    }
    return DGFEM_OK;
}

/* Adds each component of one side, with its voids, as an element to come. */
static dgfem_status dgfemi_split_add_components(dgfemi_splitter *s, const dgfemi_ints *codes,
                                                const dgfemi_split_child *child) {
    dgfem_status status;
    int i;
    if (!dgfemi_parts_find(&s->parts, codes) || !dgfemi_parts_measure(&s->parts)) return DGFEM_ERROR_MEMORY;
    if (s->parts.crowded)
        return dgfemi_fail(&s->mesh->hooks, DGFEM_ERROR_INVARIANT, "element %d: a part meets itself at an edge",
                           child->parent);
    status = dgfemi_split_check_volumes(s, child);
    if (!status) status = dgfemi_parts_attach_voids(&s->parts);
    for (i = 0; !status && i < s->parts.count; i++)
        if (s->parts.volume[i] > 0) status = dgfemi_split_add_child(s, codes, i, *child);
    return status;
}

static dgfem_status dgfemi_split_element(dgfemi_splitter *s, int element) {
    dgfemi_split_child child;
    dgfem_status status;
    memset(&child, 0, sizeof child);
    child.parent = child.element = element;
    status = dgfemi_split_sort_faces(s, element);
    if (!status) status = dgfemi_split_close(s, element, &child.cap_start, &child.cap_end);
    for (child.side = -1; !status && child.side < 2; child.side += 2) {
        const dgfemi_ints *codes = child.side < 0 ? &s->below : &s->above;
        if (s->components) status = dgfemi_split_add_components(s, codes, &child);
        else status = dgfemi_split_add_child(s, codes, DGFEM_NONE, child);
    }
    return status;
}

/* ---- what lies outside the split ---- */

/* An element outside with its cut faces replaced by their parts. */
static dgfem_status dgfemi_split_renew_element(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_split_child child;
    int k, i;
    memset(&child, 0, sizeof child);
    child.parent = child.element = element;
    s->below.count = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k], is_cut = s->cut[f].generation == s->generation;
        int first = is_cut ? s->cut[f].first : f, count = is_cut ? s->cut[f].below + s->cut[f].above : 1;
        for (i = 0; i < count; i++)
            if (!dgfemi_push(&mesh->hooks, &s->below, 2 * (first + i))) return DGFEM_ERROR_MEMORY;
    }
    return dgfemi_split_add_child(s, &s->below, DGFEM_NONE, child);
}

static dgfem_status dgfemi_split_renew_neighbours(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_status status = DGFEM_OK;
    int i, side;
    for (i = 0; !status && i < s->cut_faces.count; i++)
        for (side = 0; !status && side < 2; side++) {
            int element = mesh->faces[s->cut_faces.data[i]].element[side];
            if (element == DGFEM_NONE || s->element_mark[element] == s->generation) continue;
            s->element_mark[element] = s->generation;
            status = dgfemi_split_renew_element(s, element);
        }
    return status;
}

/* The crossing vertex on an edge, or DGFEM_NONE. */
static int dgfemi_split_find_crossing(const dgfemi_splitter *s, int a, int b) {
    const dgfemi_edge_slot *slot;
    if (dgfemi_split_sign(s, a) * dgfemi_split_sign(s, b) >= 0) return DGFEM_NONE;
    slot = dgfemi_edge_map_at(&s->crossings, a, b);
    return dgfemi_edge_map_has(&s->crossings, slot) ? slot->value : DGFEM_NONE;
}

static int dgfemi_split_has_crossing(const dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (dgfemi_split_find_crossing(s, loop[i], loop[i + 1 < count ? i + 1 : 0]) != DGFEM_NONE) return 1;
    }
    return 0;
}

/* New loops for a face, with the vertices on its split edges. */
static dgfem_status dgfemi_split_reloop_face(dgfemi_splitter *s, int f) {
    dgfem_mesh *mesh = s->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_face face = mesh->faces[f];
    int l, i, first = mesh->loop_count;
    for (l = face.loop_start; l < face.loop_start + face.loop_count; l++) {
        dgfem_loop loop = mesh->loops[l];
        s->scratch_a.count = 0;
        for (i = 0; i < loop.count; i++) {
            int a = mesh->loop_vertices[loop.start + i];
            int crossing = dgfemi_split_find_crossing(s, a, mesh->loop_vertices[loop.start + (i + 1) % loop.count]);
            if (!dgfemi_push(hooks, &s->scratch_a, a)) return DGFEM_ERROR_MEMORY;
            if (crossing != DGFEM_NONE && !dgfemi_push(hooks, &s->scratch_a, crossing)) return DGFEM_ERROR_MEMORY;
        }
        if (dgfemi_mesh_add_loop(mesh, s->scratch_a.data, s->scratch_a.count) == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    }
    if (s->reloop_count == s->reloop_capacity) {
        void *grown = dgfemi_grow(hooks, s->reloops, &s->reloop_capacity, s->reloop_count + 1,
                                  sizeof(dgfemi_split_reloop));
        if (!grown) return DGFEM_ERROR_MEMORY;
        s->reloops = (dgfemi_split_reloop *)grown;
    }
    s->reloops[s->reloop_count].face = f;
    s->reloops[s->reloop_count++].loop_start = first;
    return DGFEM_OK;
}

/* Enters the crossing vertices into the loops of faces that were not cut but run along a split edge: those of elements
   that touch the split ones at that edge alone, too. */
static dgfem_status dgfemi_split_reloop_faces(dgfemi_splitter *s) {
    dgfem_status status = DGFEM_OK;
    int f;
    for (f = 0; !status && f < s->face_count; f++) {
        const dgfem_face *face = &s->mesh->faces[f];
        if (face->element[0] == DGFEM_NONE || s->cut[f].generation == s->generation) continue;
        if (dgfemi_split_has_crossing(s, face)) status = dgfemi_split_reloop_face(s, f);
    }
    return status;
}

/* ---- commit ---- */

/* Puts a child where its parent was on one side of a face. A cap has the parent on both sides, below on side 0. */
static void dgfemi_split_set_side(dgfem_mesh *mesh, const dgfemi_split_child *child, int face) {
    dgfem_face *f = &mesh->faces[face];
    if (face >= child->cap_start && face < child->cap_end) f->element[child->side > 0] = child->element;
    else f->element[f->element[0] == child->parent ? 0 : 1] = child->element;
}

/* The first child of each parent takes its place, the others are appended. There is room for all. */
static void dgfemi_split_commit_children(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    int c, k, last_parent = DGFEM_NONE;
    for (c = 0; c < s->child_count; c++) {
        dgfemi_split_child *child = &s->children[c];
        dgfem_element *element;
        if (child->parent == last_parent) {
            child->element = mesh->element_count++;
            mesh->elements[child->element] = mesh->elements[child->parent];
        }
        last_parent = child->parent;
        element = &mesh->elements[child->element];
        element->face_start = mesh->element_face_count;
        element->face_count = child->face_count;
        for (k = child->face_start; k < child->face_start + child->face_count; k++) {
            int face = s->child_faces.data[k] / 2;
            mesh->element_faces[mesh->element_face_count++] = face;
            if (child->element != child->parent || face >= s->face_count) dgfemi_split_set_side(mesh, child, face);
        }
    }
}

static dgfem_status dgfemi_split_commit(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    int i;
    if (!dgfemi_mesh_reserve(mesh, 0, 0, s->child_count, 0, 0, s->child_faces.count)) return DGFEM_ERROR_MEMORY;
    dgfemi_split_commit_children(s);
    for (i = 0; i < s->cut_faces.count; i++) {
        dgfem_face *face = &mesh->faces[s->cut_faces.data[i]];
        face->element[0] = face->element[1] = DGFEM_NONE;
    }
    for (i = 0; i < s->reloop_count; i++) mesh->faces[s->reloops[i].face].loop_start = s->reloops[i].loop_start;
    if (!s->measure) return DGFEM_OK;
    for (i = s->face_count; i < mesh->face_count; i++) dgfemi_mesh_measure_face(mesh, i);
    for (i = 0; i < s->reloop_count; i++) dgfemi_mesh_measure_face(mesh, s->reloops[i].face);
    for (i = 0; i < s->child_count; i++) dgfemi_mesh_measure_element(mesh, s->children[i].element);
    return DGFEM_OK;
}

/* ---- the split ---- */

/* Room for the extents of all faces; those of new faces are not known. 1 on success, 0 when out of memory. */
static int dgfemi_split_fit_extents(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    void *extent = s->extent;
    int ok = dgfemi_mesh_room(&mesh->hooks, &extent, 0, &s->extent_capacity, 2 * mesh->face_count, sizeof(dgfem_real));
    s->extent = (dgfem_real *)extent;
    for (; ok && s->extent_count < mesh->face_count; s->extent_count++)
        s->extent[2 * s->extent_count] = 1, s->extent[2 * s->extent_count + 1] = 0;
    return ok;
}

/* Empties what a call fills and remembers where the mesh ends. */
static dgfem_status dgfemi_split_begin(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    void *cut = s->cut, *marks = s->element_mark;
    int ok = dgfemi_fit_zero(hooks, &cut, &s->cut_capacity, mesh->face_count, sizeof(dgfemi_cut_face));
    s->cut = (dgfemi_cut_face *)cut;
    ok = ok && dgfemi_fit_zero(hooks, &marks, &s->element_mark_capacity, mesh->element_count, sizeof(unsigned));
    s->element_mark = (unsigned *)marks;
    ok = ok && (s->axis == DGFEM_NONE || dgfemi_split_fit_extents(s));
    s->vertex_count = mesh->vertex_count, s->face_count = mesh->face_count;
    s->loop_count = mesh->loop_count, s->loop_vertex_count = mesh->loop_vertex_count;
    s->child_count = s->reloop_count = 0;
    s->child_faces.count = s->cut_faces.count = 0;
    if (++s->generation == 0) {
        memset(s->cut, 0, (size_t)s->cut_capacity * sizeof(dgfemi_cut_face));
        memset(s->element_mark, 0, (size_t)s->element_mark_capacity * sizeof(unsigned));
        s->generation = 1;
    }
    return ok && dgfemi_edge_map_begin(hooks, &s->crossings, s->crossings.size / 2) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Forgets all that was appended. */
static void dgfemi_split_roll_back(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    mesh->vertex_count = s->vertex_count, mesh->face_count = s->face_count;
    mesh->loop_count = s->loop_count, mesh->loop_vertex_count = s->loop_vertex_count;
}

/* Splits elements that all have vertices below and above the plane that is set. Their children are s->children[]; the
   first one of each parent is below and keeps the parent's index. On failure the mesh is as it was. */
static dgfem_status dgfemi_split_straddling(dgfemi_splitter *s, const int *elements, int count) {
    dgfem_status status = dgfemi_split_begin(s);
    int i;
    for (i = 0; !status && i < count; i++) {
        s->element_mark[elements[i]] = s->generation;
        status = dgfemi_split_element(s, elements[i]);
        s->failed_element = elements[i];
    }
    if (!status && !s->all) status = dgfemi_split_renew_neighbours(s);
    if (!status && !s->all) status = dgfemi_split_reloop_faces(s);
    if (!status) status = dgfemi_split_commit(s);
    if (status) dgfemi_split_roll_back(s);
    return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&s->mesh->hooks) : status;
}

/* ---- axis planes ---- */

/* Prepares for planes across an axis. 1 on success, 0 when out of memory. */
static int dgfemi_split_set_axis(dgfemi_splitter *s, int axis) {
    const dgfem_mesh *mesh = s->mesh;
    void *height = s->height;
    int v, ok = dgfemi_mesh_room(&mesh->hooks, &height, 0, &s->height_capacity, mesh->vertex_count, sizeof(dgfem_real));
    s->height = (dgfem_real *)height;
    if (!ok) return 0;
    s->axis = axis;
    s->normal = dgfemi_vec3(axis == 0, axis == 1, axis == 2);
    s->snapped = 0;
    s->extent_count = 0;
    for (v = 0; v < mesh->vertex_count; v++) s->height[v] = dgfemi_axis(mesh->vertices[v], axis);
    return dgfemi_split_fit_extents(s);
}

/* ---- any plane ---- */

/* Heights of all vertices above the plane. What round-off alone may have put beside it counts as on it, so that a second
   cut where there is one already changes nothing. 1 on success, 0 when out of memory. */
static int dgfemi_split_set_plane(dgfemi_splitter *s, dgfem_plane plane) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_vec3 n = plane.normal;
    dgfem_real size = dgfemi_abs(plane.offset);
    void *height = s->height;
    int v, ok = dgfemi_mesh_room(&mesh->hooks, &height, 0, &s->height_capacity, mesh->vertex_count, sizeof(dgfem_real));
    s->height = (dgfem_real *)height;
    if (!ok) return 0;
    s->axis = DGFEM_NONE;
    s->plane = plane;
    s->normal = dgfemi_abs(dgfemi_dot(n, n) - 1) <= 4 * DGFEM_EPSILON ? n : dgfemi_normalized(n);
    s->snapped = 0;
    for (v = 0; v < mesh->vertex_count; v++) {
        dgfem_vec3 p = mesh->vertices[v];
        size = dgfemi_max(size, dgfemi_abs(n.x * p.x) + dgfemi_abs(n.y * p.y) + dgfemi_abs(n.z * p.z));
        s->height[v] = dgfemi_dot(n, p) - plane.offset;
    }
    s->high = 16 * DGFEM_EPSILON * size;
    s->low = -s->high;
    return 1;
}

static void dgfemi_split_mark_edge(dgfemi_splitter *s, int a, int b) {
    dgfem_real height_a = dgfemi_abs(s->height[a]), height_b = dgfemi_abs(s->height[b]);
    if (dgfemi_split_sign(s, a) * dgfemi_split_sign(s, b) >= 0) return;
    if (height_a < s->snap * height_b && s->snap_mark[a] == 0) s->snap_mark[a] = 1;
    if (height_b < s->snap * height_a && s->snap_mark[b] == 0) s->snap_mark[b] = 1;
}

/* Marks the vertices of an element that are near the plane compared with the other end of an edge that crosses it. */
static void dgfemi_split_mark_element(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++) dgfemi_split_mark_edge(s, loop[i], loop[i + 1 < count ? i + 1 : 0]);
        }
    }
}

static int dgfemi_split_straddles(const dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, below = 0, above = 0;
    for (k = e->face_start; k < e->face_start + e->face_count && !(below && above); k++) {
        dgfemi_face_signs signs = dgfemi_split_count_signs(s, &mesh->faces[mesh->element_faces[k]]);
        below |= signs.below, above |= signs.above;
    }
    return below && above;
}

/* 1 when the vertices strictly between corners `first` and `end` of a loop lie on the line through these two. */
static int dgfemi_split_is_straight(const dgfemi_splitter *s, const int *loop, int count, int first, int end) {
    const dgfem_vec3 *vertices = s->mesh->vertices;
    dgfem_vec3 a = vertices[loop[first % count]], along = dgfemi_sub(vertices[loop[end % count]], a);
    dgfem_real tolerance = 4 * s->high / dgfemi_norm(s->plane.normal) * dgfemi_norm(along);
    int i;
    for (i = first + 1; i < end; i++)
        if (!(dgfemi_norm(dgfemi_cross(dgfemi_sub(vertices[loop[i % count]], a), along)) <= tolerance)) return 0;
    return 1;
}

/* Where both ends of a straight run of edges are on the plane, or marked, so are the vertices between them: with them
   beside it the run would enclose a sliver without area. Returns the number of new marks. */
static int dgfemi_split_mark_runs(dgfemi_splitter *s, const int *loop, int count) {
    int first, end, i, marks = 0;
    for (first = 0; first < count; first++) {
        if (s->snap_mark[loop[first]] != 1 && dgfemi_split_sign(s, loop[first]) != 0) continue;
        for (end = first + 1; end < first + count; end++)
            if (s->snap_mark[loop[end % count]] == 1 || dgfemi_split_sign(s, loop[end % count]) == 0) break;
        if (end == first + 1 || end == first + count || !dgfemi_split_is_straight(s, loop, count, first, end)) continue;
        for (i = first + 1; i < end; i++)
            if (s->snap_mark[loop[i % count]] == 0) s->snap_mark[loop[i % count]] = 1, marks++;
    }
    return marks;
}

static int dgfemi_split_mark_runs_of(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, marks = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            marks += dgfemi_split_mark_runs(s, mesh->loop_vertices + mesh->loops[l].start, mesh->loops[l].count);
    }
    return marks;
}

/* Makes all marks zero. 1 on success, 0 when out of memory. */
static int dgfemi_split_clear_marks(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    void *snap_mark = s->snap_mark;
    int ok = dgfemi_mesh_room(&mesh->hooks, &snap_mark, 0, &s->snap_mark_capacity, mesh->vertex_count, 1);
    s->snap_mark = (signed char *)snap_mark;
    if (ok && mesh->vertex_count > 0) memset(s->snap_mark, 0, (size_t)mesh->vertex_count);
    return ok;
}

/* Puts the vertices of the elements that are to be snapped on the plane. */
static void dgfemi_split_snap(dgfemi_splitter *s, const int *elements, int count) {
    int i, v, marks;
    for (v = 0; v < s->mesh->vertex_count; v++)
        if (s->snap_mark[v] == 1) s->snap_mark[v] = 0;
    for (i = 0; i < count; i++) dgfemi_split_mark_element(s, elements ? elements[i] : i);
    do {
        for (marks = 0, i = 0; i < count; i++) marks += dgfemi_split_mark_runs_of(s, elements ? elements[i] : i);
    } while (marks > 0);
    for (v = 0; v < s->mesh->vertex_count; v++)
        if (s->snap_mark[v] == 1) s->height[v] = 0, s->snapped = 1;
}

/* Sets the plane and selects those of the elements (NULL: of the first `count`) that straddle it. */
static dgfem_status dgfemi_split_select(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    int i;
    if (!dgfemi_split_set_plane(s, plane)) return dgfemi_fail_memory(&s->mesh->hooks);
    if (s->snap > 0) dgfemi_split_snap(s, elements, count);
    s->selected.count = 0;
    for (i = 0; i < count; i++) {
        int element = elements ? elements[i] : i;
        if (dgfemi_split_straddles(s, element) && !dgfemi_push(&s->mesh->hooks, &s->selected, element))
            return dgfemi_fail_memory(&s->mesh->hooks);
    }
    return DGFEM_OK;
}

/* One attempt; where vertices were snapped it fails silently. */
static dgfem_status dgfemi_split_try(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    dgfem_hooks hooks = s->mesh->hooks;
    dgfem_status status = dgfemi_split_select(s, plane, elements, count);
    if (status) return status;
    if (s->snapped) s->mesh->hooks.log = NULL;
    status = dgfemi_split_straddling(s, s->selected.data, s->selected.count);
    s->mesh->hooks.log = hooks.log;
    return s->snapped && status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&hooks) : status;
}

/* Forbids to snap the vertices of an element. */
static void dgfemi_split_release(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++)
                s->snap_mark[mesh->loop_vertices[mesh->loops[l].start + i]] = -1;
    }
}

/* Splits those of the given elements (NULL: of the first `count`) that straddle the plane, in place; they are
   s->selected, their children s->children. On failure the mesh is as it was. Leaves dead items. An element that does not
   take the snapping well keeps its vertices off the plane. */
static dgfem_status dgfemi_split_elements(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    enum { MAX_RELEASES = 16 };
    dgfem_real snap = s->snap;
    dgfem_status status;
    int releases;
    if (snap > 0 && !dgfemi_split_clear_marks(s)) return dgfemi_fail_memory(&s->mesh->hooks);
    status = dgfemi_split_try(s, plane, elements, count);
    for (releases = 1; status && status != DGFEM_ERROR_MEMORY && s->snapped; releases++) {
        dgfemi_split_release(s, s->failed_element);
        if (releases == MAX_RELEASES) s->snap = 0;
        status = dgfemi_split_try(s, plane, elements, count);
    }
    s->snap = snap;
    return status;
}

static dgfem_status dgfemi_split_check_plane(const dgfem_hooks *hooks, dgfem_plane plane) {
    dgfem_vec3 n = plane.normal;
    if (!dgfemi_is_finite3(n) || !dgfemi_is_finite(plane.offset))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "plane: normal %g %g %g, offset %g", (double)n.x, (double)n.y,
                           (double)n.z, (double)plane.offset);
    if (!(dgfemi_norm(n) > 0)) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "plane: its normal is zero");
    return DGFEM_OK;
}

/* On a copy, because the compaction, too, can fail. */
static dgfem_status dgfemi_mesh_split(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split) {
    dgfem_mesh *copy = dgfemi_mesh_duplicate(mesh);
    dgfemi_splitter s;
    dgfem_status status;
    if (!copy) return dgfemi_fail_memory(&mesh->hooks);
    s = dgfemi_splitter_make(copy);
    s.snap = snap;
    s.components = s.all = s.measure = 1;
    status = dgfemi_split_elements(&s, plane, NULL, copy->element_count);
    if (!status && s.selected.count > 0) status = dgfemi_mesh_compact(copy);
    if (!status) {
        *split = s.selected.count;
        dgfemi_mesh_swap(mesh, copy);
    }
    dgfemi_splitter_free(&s);
    dgfem_mesh_destroy(copy);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_split_plane(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split) {
    dgfem_status status;
    int count = 0;
    if (split) *split = 0;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_split_check_plane(&mesh->hooks, plane);
    if (status) return status;
    if (!(snap >= 0) || !(snap < 1))
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "snap %g is not in [0, 1)", (double)snap);
    status = dgfemi_mesh_split(mesh, plane, snap, &count);
    if (!status && split) *split = count;
    return status;
}

/* ---- the stand-alone polyhedron ---- */

/* The polyhedron as a mesh of one element, not measured; NULL when out of memory. */
static dgfem_mesh *dgfemi_polyhedron_to_mesh(const dgfem_polyhedron *polyhedron) {
    dgfem_mesh *mesh = dgfemi_mesh_new(&polyhedron->hooks);
    int faces = polyhedron->face_count, loops = polyhedron->face_loops[faces], f, l, v;
    if (!mesh) return NULL;
    if (!dgfemi_mesh_reserve(mesh, polyhedron->vertex_count, faces, 1, loops, polyhedron->loop_start[loops], faces)) {
        dgfem_mesh_destroy(mesh);
        return NULL;
    }
    for (v = 0; v < polyhedron->vertex_count; v++) (void)dgfemi_mesh_add_vertex(mesh, polyhedron->vertices[v]);
    for (f = 0; f < faces; f++) {
        int first = polyhedron->face_loops[f], end = polyhedron->face_loops[f + 1];
        for (l = first; l < end; l++)
            (void)dgfemi_mesh_add_loop(mesh, polyhedron->loop_vertices + polyhedron->loop_start[l],
                                       polyhedron->loop_start[l + 1] - polyhedron->loop_start[l]);
        (void)dgfemi_mesh_add_face(mesh, first, end - first, 0, DGFEM_NONE, f, dgfemi_vec3(0, 0, 0));
        mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
        mesh->element_faces[f] = f;
    }
    mesh->element_face_count = faces;
    mesh->element_count = 1;
    memset(mesh->elements, 0, sizeof(dgfem_element));
    mesh->elements[0].face_count = faces;
    return mesh;
}

/* Every directed edge of the only element must have its opposite: else a cut does not close. */
static dgfem_status dgfemi_split_check_closed(const dgfem_mesh *mesh) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_status status = DGFEM_OK;
    dgfemi_edges edges;
    int f, i;
    memset(&edges, 0, sizeof edges);
    if (!dgfemi_edges_reset(hooks, &edges, mesh->loop_vertex_count)) status = dgfemi_fail_memory(hooks);
    for (f = 0; !status && f < mesh->face_count; f++) dgfemi_edges_add_face(mesh, &edges, f, 1);
    for (i = 0; !status && i < edges.count; i++) {
        const dgfemi_edge *edge = &edges.data[i];
        if (edge->forward != edge->backward)
            status = dgfemi_fail(hooks, DGFEM_ERROR_OPEN, "edge from vertex %d to %d occurs %d times, its opposite %d",
                                 edge->a, edge->b, edge->forward, edge->backward);
    }
    dgfemi_edges_free(hooks, &edges);
    return status;
}

/* The parts of a mesh of one element, each with all its components. */
static dgfem_status dgfemi_split_parts(dgfem_mesh *mesh, dgfem_plane plane, dgfem_polyhedron *parts[2]) {
    dgfemi_splitter s = dgfemi_splitter_make(mesh);
    dgfem_status status;
    int i, element = 0;
    s.all = 1;
    status = dgfemi_split_elements(&s, plane, &element, 1);
    if (!status && s.selected.count > 0) {
        status = dgfem_mesh_element_polyhedron(mesh, 0, &parts[0]);
        if (!status) status = dgfem_mesh_element_polyhedron(mesh, 1, &parts[1]);
    } else if (!status) {
        for (i = 0; i < mesh->loop_vertex_count && dgfemi_split_sign(&s, mesh->loop_vertices[i]) >= 0; i++) {}
        status = dgfem_mesh_element_polyhedron(mesh, 0, &parts[i == mesh->loop_vertex_count]);
    }
    dgfemi_splitter_free(&s);
    return status;
}

DGFEM_API dgfem_status dgfem_polyhedron_split(const dgfem_polyhedron *polyhedron, dgfem_plane plane,
                                              dgfem_polyhedron **below, dgfem_polyhedron **above) {
    dgfem_polyhedron *parts[2] = {NULL, NULL};
    dgfem_mesh *mesh;
    dgfem_status status;
    if (below) *below = NULL;
    if (above) *above = NULL;
    if (!polyhedron || !below || !above) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_split_check_plane(&polyhedron->hooks, plane);
    if (status) return status;
    mesh = dgfemi_polyhedron_to_mesh(polyhedron);
    if (!mesh) return dgfemi_fail_memory(&polyhedron->hooks);
    status = dgfemi_split_check_closed(mesh);
    if (!status) status = dgfemi_split_parts(mesh, plane, parts);
    dgfem_mesh_destroy(mesh);
    if (status) {
        dgfem_polyhedron_destroy(parts[0]);
        dgfem_polyhedron_destroy(parts[1]);
        return status;
    }
    *below = parts[0], *above = parts[1];
    return DGFEM_OK;
}
