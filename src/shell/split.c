#pragma once
#include "cut.c"
/* Cuts across elements: triangles that follow a plane take the place of the elements that it crosses.

   Corners are below (-1), on (0) or above (1) the plane. Every run of corners below, between two points of the boundary
   on the plane (a corner that counts as on it, or a crossed side), is cut off by one chord:

        + ------- +            The sides' crossing points become corners, in place of the sides' middle nodes: so no
        |         |            node is left over. Each part is divided into triangles with the best worst angle.
        x . chord x            An element that is not cut itself, but whose side was crossed, is divided likewise.
        |  .    . |
        - --- - --             */

enum { DGFEM_SHELLI_MAX_POLYGON = 8 };

typedef struct dgfem_shelli_splitter {
    dgfem_shelli_edit *edit;
    const dgfem_shell_cut_desc *desc;
    dgfem_real *distance; /* [old nodes] of corners from the plane */
    signed char *side;    /* [old nodes] of corners */
    char *cut;            /* [old elements] whether the cut runs through */
    dgfem_real *crossing; /* [old edges] where a split edge is split, 0 < t < 1 from its start; 0: not split */
    int *half;            /* [2 * old edges] new middle nodes of a split edge */
    int elements_split;
} dgfem_shelli_splitter;

/* ---- where the plane runs ---- */

static dgfem_real dgfem_shelli_plane_distance(const dgfem_shelli_splitter *s, int node) {
    const dgfem_shell *shell = s->edit->old;
    const dgfem_vec3 *x = s->desc->current ? shell->position : shell->rest;
    return dgfem_shelli_dot(s->desc->plane.normal, x[node]) - s->desc->plane.offset;
}

/* Whether a point is between the planes that bound the cut. */
static int dgfem_shelli_in_bounds(const dgfem_shell_cut_desc *desc, dgfem_vec3 x) {
    dgfem_vec3 along = dgfem_shelli_sub(desc->to, desc->from);
    dgfem_real t = dgfem_shelli_dot(along, dgfem_shelli_sub(x, desc->from));
    return !desc->bounded || (t >= 0 && t <= dgfem_shelli_dot(along, along));
}

static void dgfem_shelli_classify(const dgfem_shelli_splitter *s) {
    const dgfem_shell *shell = s->edit->old;
    for (int i = 0; i < shell->node_count; i++) {
        s->distance[i] = dgfem_shelli_plane_distance(s, i);
        s->side[i] = (signed char)(s->distance[i] > 0 ? 1 : s->distance[i] < 0 ? -1 : 0);
    }
    for (int i = 0; i < shell->edge_count; i++) {
        int a = shell->edges[i].node[0], b = shell->edges[i].node[1];
        dgfem_real da = dgfem_shelli_abs(s->distance[a]), db = dgfem_shelli_abs(s->distance[b]);
        if (!((s->distance[a] < 0 && s->distance[b] > 0) || (s->distance[a] > 0 && s->distance[b] < 0))) continue;
        if (da <= s->desc->snap * (da + db)) s->side[a] = 0;
        if (db <= s->desc->snap * (da + db)) s->side[b] = 0;
    }
}

static int dgfem_shelli_is_crossed(const dgfem_shelli_splitter *s, int edge) {
    const int *node = s->edit->old->edges[edge].node;
    return s->side[node[0]] * s->side[node[1]] < 0;
}

/* Middle of the points where an element's boundary meets the plane. 0 where the plane does not run through it. */
static int dgfem_shelli_crosses(const dgfem_shelli_splitter *s, int e, dgfem_vec3 *middle) {
    const dgfem_shell *shell = s->edit->old;
    const dgfem_shell_element *element = &shell->elements[e];
    const dgfem_vec3 *x = s->desc->current ? shell->position : shell->rest;
    int corners = dgfem_shelli_corners(element), above = 0, below = 0, points = 0;
    *middle = dgfem_shelli_vec3(0, 0, 0);
    for (int k = 0; k < corners; k++) {
        int a = element->node[k], b = element->node[(k + 1) % corners];
        above += s->side[a] > 0;
        below += s->side[a] < 0;
        if (s->side[a] == 0) *middle = dgfem_shelli_add(*middle, x[a]), points++;
        if (s->side[a] * s->side[b] >= 0) continue;
        dgfem_real t = s->distance[a] / (s->distance[a] - s->distance[b]);
        *middle = dgfem_shelli_add(*middle, dgfem_shelli_axpy(x[a], t, dgfem_shelli_sub(x[b], x[a])));
        points++;
    }
    if (!above || !below) return 0;
    *middle = dgfem_shelli_scale(1 / (dgfem_real)points, *middle);
    return 1;
}

/* The root of the distance along a crossed edge, kept away from its ends. */
static dgfem_real dgfem_shelli_crossing(const dgfem_shelli_splitter *s, const int *node) {
    dgfem_real da = s->distance[node[0]], db = s->distance[node[1]], dm = s->distance[node[2]], low = 0, high = 1;
    dgfem_real margin = dgfem_shelli_max(DGFEM_R(0.5) * s->desc->snap, DGFEM_R(1e-3));
    for (int k = 0; k < 60; k++) {
        dgfem_real t = DGFEM_R(0.5) * (low + high);
        dgfem_real d = da * (1 - t) * (1 - 2 * t) + 4 * dm * t * (1 - t) + db * t * (2 * t - 1);
        if ((d > 0) == (da > 0)) low = t;
        else high = t;
    }
    return low < margin ? margin : low > 1 - margin ? 1 - margin : low;
}

/* ---- splitting edges ---- */

/* Puts a point of an old element at node `at` of the new topology, or at one more where that is DGFEM_NONE. Returns the
   node. */
static int dgfem_shelli_interpolate(dgfem_shelli_edit *edit, const dgfem_shell_element *element,
                                    dgfem_shelli_parameter p, int at) {
    const dgfem_shell *old = edit->old;
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES], rest, position, velocity;
    dgfem_shelli_basis f;
    int n = element->node_count;
    dgfem_shelli_basis_at(n, p, &f);
    dgfem_shelli_gather(old->rest, element->node, n, x);
    rest = dgfem_shelli_sum(f.n, x, n);
    dgfem_shelli_gather(old->position, element->node, n, x);
    position = dgfem_shelli_sum(f.n, x, n);
    dgfem_shelli_gather(old->velocity, element->node, n, x);
    velocity = dgfem_shelli_sum(f.n, x, n);
    if (at == DGFEM_NONE) return dgfem_shelli_edit_node(edit, rest, position, velocity);
    edit->rest[at] = rest, edit->position[at] = position, edit->velocity[at] = velocity;
    return at;
}

/* The middle node moves to the crossing and becomes a corner; two new ones are made. */
static void dgfem_shelli_split_edge(dgfem_shelli_splitter *s, int index) {
    dgfem_shelli_edit *edit = s->edit;
    const dgfem_shell_edge *edge = &edit->old->edges[index];
    const dgfem_shell_element *element = &edit->old->elements[edge->element[0]];
    dgfem_real t = s->crossing[index] = dgfem_shelli_crossing(s, edge->node);
    int n = element->node_count, side = edge->side[0];
    (void)dgfem_shelli_interpolate(edit, element, dgfem_shelli_side(n, side, 2 * t - 1), edge->node[2]);
    for (int k = 0; k < 2; k++) {
        int node = dgfem_shelli_interpolate(edit, element, dgfem_shelli_side(n, side, k ? t : t - 1), DGFEM_NONE);
        edit->edge_from[node] = edit->on_edge[node] = index;
        edit->joint[node] = (char)edge->joint;
        s->half[2 * index + k] = node;
    }
    edit->moved_to[edge->node[2]] = s->half[2 * index + (t < DGFEM_R(0.5))];
    edit->to_crossing[edge->node[2]] = 3 * t >= 1 && 3 * t <= 2; /* nearer than the middle of the part */
    edit->edge_from[edge->node[2]] = DGFEM_NONE;
    edit->joint[edge->node[2]] = DGFEM_SHELL_GLUED;
}

/* ---- dividing elements ---- */

typedef struct dgfem_shelli_polygon {
    int count;
    int node[DGFEM_SHELLI_MAX_POLYGON];
    dgfem_shelli_parameter at[DGFEM_SHELLI_MAX_POLYGON];
    int side[DGFEM_SHELLI_MAX_POLYGON];                             /* of the plane */
    int middle[DGFEM_SHELLI_MAX_POLYGON][DGFEM_SHELLI_MAX_POLYGON]; /* of the line between two points, or DGFEM_NONE */
    dgfem_vec3 x[DGFEM_SHELLI_MAX_POLYGON];                         /* at rest */
} dgfem_shelli_polygon;

static void dgfem_shelli_polygon_push(dgfem_shelli_polygon *polygon, const dgfem_shelli_edit *edit, int node,
                                      dgfem_shelli_parameter at, int side) {
    int i = polygon->count++;
    polygon->node[i] = node;
    polygon->at[i] = at;
    polygon->side[i] = side;
    polygon->x[i] = edit->rest[node];
}

/* The element's boundary with its crossing points. */
static void dgfem_shelli_polygon_make(const dgfem_shelli_splitter *s, const dgfem_shell_element *element, int e,
                                      dgfem_shelli_polygon *polygon) {
    const dgfem_shelli_edit *edit = s->edit;
    int n = element->node_count, corners = n / 2, middle[DGFEM_SHELLI_MAX_POLYGON];
    polygon->count = 0;
    for (int k = 0; k < corners; k++) {
        int index = element->edge[k], forward = edit->old->edges[index].element[0] == e;
        dgfem_real t = s->crossing[index];
        forward = forward && edit->old->edges[index].side[0] == k;
        middle[polygon->count] = element->node[corners + k];
        if (t > 0) middle[polygon->count] = s->half[2 * index + !forward];
        dgfem_shelli_polygon_push(polygon, edit, element->node[k], dgfem_shelli_corner(n, k),
                                  s->side[element->node[k]]);
        if (!(t > 0)) continue;
        middle[polygon->count] = s->half[2 * index + forward];
        dgfem_shelli_polygon_push(polygon, edit, element->node[corners + k],
                                  dgfem_shelli_side(n, k, forward ? 2 * t - 1 : 1 - 2 * t), 0);
    }
    for (int i = 0; i < polygon->count; i++)
        for (int j = 0; j < polygon->count; j++) polygon->middle[i][j] = DGFEM_NONE;
    for (int i = 0; i < polygon->count; i++) {
        int j = (i + 1) % polygon->count;
        polygon->middle[i][j] = polygon->middle[j][i] = middle[i];
    }
}

static int dgfem_shelli_polygon_middle(dgfem_shelli_splitter *s, const dgfem_shell_element *element,
                                       dgfem_shelli_polygon *polygon, int i, int j) {
    if (polygon->middle[i][j] == DGFEM_NONE) {
        dgfem_shelli_parameter p = polygon->at[i], q = polygon->at[j];
        p = dgfem_shelli_parameter_make((p.a + q.a) / 2, (p.b + q.b) / 2);
        polygon->middle[i][j] = polygon->middle[j][i] = dgfem_shelli_interpolate(s->edit, element, p, DGFEM_NONE);
    }
    return polygon->middle[i][j];
}

/* How bad a triangle is: longest side squared by area, large where it is flat in the parameters. */
static dgfem_real dgfem_shelli_badness(const dgfem_shelli_polygon *polygon, int i, int j, int k) {
    dgfem_shelli_parameter p = polygon->at[i], q = polygon->at[j], r = polygon->at[k];
    dgfem_vec3 a = dgfem_shelli_sub(polygon->x[j], polygon->x[i]), b = dgfem_shelli_sub(polygon->x[k], polygon->x[j]);
    dgfem_vec3 c = dgfem_shelli_sub(polygon->x[i], polygon->x[k]);
    dgfem_real flat = (q.a - p.a) * (r.b - p.b) - (q.b - p.b) * (r.a - p.a);
    dgfem_real longest =
        dgfem_shelli_max(dgfem_shelli_dot(a, a), dgfem_shelli_max(dgfem_shelli_dot(b, b), dgfem_shelli_dot(c, c)));
    dgfem_real area = dgfem_shelli_norm(dgfem_shelli_cross(a, b));
    if (!(flat > DGFEM_R(1e-5)) || !(area > DGFEM_R(1e-12) * longest)) return DGFEM_R(1e30);
    return longest / area;
}

static void dgfem_shelli_add_triangle(dgfem_shelli_splitter *s, const dgfem_shell_element *element, int e,
                                      dgfem_shelli_polygon *polygon, int i, int j, int k, int *pieces) {
    dgfem_shelli_edit *edit = s->edit;
    int to = (*pieces)++ ? edit->element_count++ : e;
    dgfem_shell_element *piece = &edit->elements[to];
    DGFEM_ASSERT(edit->element_count <= edit->element_capacity);
    *piece = *element;
    piece->node_count = 6;
    piece->node[0] = polygon->node[i], piece->node[1] = polygon->node[j], piece->node[2] = polygon->node[k];
    piece->node[3] = dgfem_shelli_polygon_middle(s, element, polygon, i, j);
    piece->node[4] = dgfem_shelli_polygon_middle(s, element, polygon, j, k);
    piece->node[5] = dgfem_shelli_polygon_middle(s, element, polygon, k, i);
    edit->element_from[to] = e;
}

/* Triangles of a part of the polygon (indices, counter-clockwise), by the classical recursion over its sub-ranges:
   best[i][j] is the least possible worst triangle between points i and j. */
static void dgfem_shelli_triangulate(dgfem_shelli_splitter *s, const dgfem_shell_element *element, int e,
                                     dgfem_shelli_polygon *polygon, const int *part, int count, int *pieces) {
    dgfem_real best[DGFEM_SHELLI_MAX_POLYGON][DGFEM_SHELLI_MAX_POLYGON] = {{0}};
    int apex[DGFEM_SHELLI_MAX_POLYGON][DGFEM_SHELLI_MAX_POLYGON] = {{0}};
    int stack[2 * DGFEM_SHELLI_MAX_POLYGON][2], top = 0;
    for (int span = 2; span < count; span++)
        for (int i = 0; i + span < count; i++) {
            int j = i + span;
            best[i][j] = DGFEM_R(1e35);
            for (int k = i + 1; k < j; k++) {
                dgfem_real worst = dgfem_shelli_badness(polygon, part[i], part[k], part[j]);
                worst = dgfem_shelli_max(worst, dgfem_shelli_max(best[i][k], best[k][j]));
                if (worst < best[i][j]) best[i][j] = worst, apex[i][j] = k;
            }
        }
    stack[top][0] = 0, stack[top++][1] = count - 1;
    while (top) {
        int i = stack[--top][0], j = stack[top][1], k = apex[i][j];
        if (j - i < 2) continue;
        dgfem_shelli_add_triangle(s, element, e, polygon, part[i], part[k], part[j], pieces);
        stack[top][0] = i, stack[top++][1] = k;
        stack[top][0] = k, stack[top++][1] = j;
    }
}

/* Cuts off every run below the plane, then divides what is left. */
static void dgfem_shelli_divide(dgfem_shelli_splitter *s, int e) {
    const dgfem_shell_element *element = &s->edit->old->elements[e];
    dgfem_shelli_polygon polygon;
    int left[DGFEM_SHELLI_MAX_POLYGON], count = 0, pieces = 0;
    dgfem_shelli_polygon_make(s, element, e, &polygon);
    int n = polygon.count;
    for (int i = 0; i < n; i++) {
        int part[DGFEM_SHELLI_MAX_POLYGON], size = 1;
        if (!s->cut[e] || polygon.side[i] != 0 || polygon.side[(i + 1) % n] >= 0) continue;
        part[0] = i;
        do part[size] = (i + size) % n;
        while (polygon.side[part[size++]] < 0);
        int joint_node = dgfem_shelli_polygon_middle(s, element, &polygon, part[0], part[size - 1]);
        s->edit->joint[joint_node] = (char)s->desc->joint;
        dgfem_shelli_triangulate(s, element, e, &polygon, part, size, &pieces);
    }
    for (int i = 0; i < n; i++)
        if (!s->cut[e] || polygon.side[i] >= 0) left[count++] = i;
    dgfem_shelli_triangulate(s, element, e, &polygon, left, count, &pieces);
    s->elements_split++;
}

/* ---- the cut ---- */

/* Mean distance of an element's corners: the side that it is on. */
static int dgfem_shelli_element_above(const dgfem_shelli_splitter *s, int e) {
    const dgfem_shell_element *element = &s->edit->old->elements[e];
    dgfem_real sum = 0;
    for (int k = 0; k < dgfem_shelli_corners(element); k++) sum += s->distance[element->node[k]];
    return sum > 0;
}

/* Whether an edge lies on the plane, between elements on either side of it. */
static int dgfem_shelli_lies_along(const dgfem_shelli_splitter *s, const dgfem_shell_edge *edge) {
    const dgfem_vec3 *x = s->desc->current ? s->edit->old->position : s->edit->old->rest;
    if (dgfem_shelli_is_boundary(edge) || s->side[edge->node[0]] || s->side[edge->node[1]]) return 0;
    if (!dgfem_shelli_in_bounds(s->desc, x[edge->node[2]])) return 0;
    return dgfem_shelli_element_above(s, edge->element[0]) != dgfem_shelli_element_above(s, edge->element[1]);
}

static void dgfem_shelli_cut_along(const dgfem_shelli_splitter *s) {
    const dgfem_shell *shell = s->edit->old;
    for (int i = 0; i < shell->edge_count; i++)
        if (dgfem_shelli_lies_along(s, &shell->edges[i]))
            s->edit->joint[shell->edges[i].node[2]] = (char)s->desc->joint;
}

/* Edges that cutting along would change. */
static int dgfem_shelli_count_along(const dgfem_shelli_splitter *s) {
    const dgfem_shell *shell = s->edit->old;
    int count = 0;
    for (int i = 0; i < shell->edge_count; i++)
        count += shell->edges[i].joint != s->desc->joint && dgfem_shelli_lies_along(s, &shell->edges[i]);
    return count;
}

/* Finds the elements that are cut and those that must be divided because a side was crossed. Returns how many. */
static int dgfem_shelli_mark_elements(dgfem_shelli_splitter *s, const dgfem_shell *shell, char *touched) {
    int count = 0;
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_vec3 middle;
        s->cut[e] = (char)(dgfem_shelli_crosses(s, e, &middle) && dgfem_shelli_in_bounds(s->desc, middle));
        if (!s->cut[e]) continue;
        touched[e] = 1;
        for (int k = 0; k < dgfem_shelli_corners(&shell->elements[e]); k++) {
            int index = shell->elements[e].edge[k];
            if (!dgfem_shelli_is_crossed(s, index)) continue;
            s->crossing[index] = 1;
            for (int side = 0; side < 2; side++)
                if (shell->edges[index].element[side] != DGFEM_NONE) touched[shell->edges[index].element[side]] = 1;
        }
    }
    for (int e = 0; e < shell->element_count; e++) count += touched[e];
    return count;
}

static dgfem_status dgfem_shelli_cut_elements(dgfem_shelli_splitter *s, dgfem_shell *shell,
                                              dgfem_shelli_scratch *scratch, dgfem_shell_cut_info *info) {
    dgfem_shelli_edit *edit = s->edit;
    size_t nodes = (size_t)shell->node_count, elements = (size_t)shell->element_count,
           edges = (size_t)shell->edge_count;
    char *touched = (char *)dgfem_shelli_take(scratch, elements, 1);
    s->distance = (dgfem_real *)dgfem_shelli_take(scratch, nodes, sizeof(dgfem_real));
    s->side = (signed char *)dgfem_shelli_take(scratch, nodes, 1);
    s->cut = (char *)dgfem_shelli_take(scratch, elements, 1);
    s->crossing = (dgfem_real *)dgfem_shelli_take(scratch, edges, sizeof(dgfem_real));
    s->half = (int *)dgfem_shelli_take(scratch, 2 * edges, sizeof(int));
    if (!touched || !s->distance || !s->side || !s->cut || !s->crossing || !s->half) return DGFEM_ERROR_MEMORY;
    edit->old = shell;
    dgfem_shelli_classify(s);
    int count = dgfem_shelli_mark_elements(s, shell, touched);
    if (!count && !dgfem_shelli_count_along(s)) { /* nothing changes */
        int *class_of = (int *)dgfem_shelli_take(scratch, elements, sizeof(int));
        int *number = (int *)dgfem_shelli_take(scratch, elements, sizeof(int));
        if (!class_of || !number) return DGFEM_ERROR_MEMORY;
        info->pieces = dgfem_shelli_count_pieces(shell, class_of, number);
        return DGFEM_OK;
    }

    /* A divided element gives six triangles and five lines inside at most; two new middles per side. */
    int element_room = shell->element_count + 5 * count, node_room = shell->node_count + 13 * count + 6 * element_room;
    dgfem_status status = dgfem_shelli_edit_begin(edit, shell, element_room, node_room);
    if (status) return status;
    for (int i = 0; i < shell->edge_count; i++)
        if (s->crossing[i] > 0) dgfem_shelli_split_edge(s, i);
    for (int e = 0; e < shell->element_count; e++)
        if (touched[e]) dgfem_shelli_divide(s, e);
    dgfem_shelli_cut_along(s);
    int *class_of = (int *)dgfem_shelli_take(scratch, (size_t)edit->element_count, sizeof(int));
    int *number = (int *)dgfem_shelli_take(scratch, (size_t)edit->element_count, sizeof(int));
    if (!class_of || !number) return DGFEM_ERROR_MEMORY;
    status = dgfem_shelli_edit_commit(edit, shell, &info->edges_cut);
    if (!status) info->pieces = dgfem_shelli_count_pieces(shell, class_of, number);
    info->elements_split = s->elements_split;
    return status;
}

static dgfem_status dgfem_shelli_check_cut(const dgfem_shell *shell, const dgfem_shell_cut_desc *desc) {
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_shelli_check_vector(shell, desc->plane.normal, "normal");
    if (!status) status = dgfem_shelli_check_real(shell, desc->plane.offset, "offset");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->from, "from");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->to, "to");
    if (!status && !(dgfem_shelli_norm(desc->plane.normal) > 0))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "the normal is zero");
    if (!status && desc->bounded && !(dgfem_shelli_norm(dgfem_shelli_sub(desc->to, desc->from)) > 0))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "a bounded cut from a point to itself");
    if (!status && !(desc->snap >= 0 && desc->snap < DGFEM_R(0.5)))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "snap is %g, expected in [0, 0.5)",
                                   (double)desc->snap);
    if (!status && ((int)desc->joint < 0 || desc->joint > DGFEM_SHELL_GAP))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "unknown joint %d", (int)desc->joint);
    return status;
}

DGFEM_API dgfem_status dgfem_shell_cut_plane(dgfem_shell *shell, const dgfem_shell_cut_desc *desc,
                                             dgfem_shell_cut_info *info) {
    dgfem_shell_cut_info local;
    dgfem_shelli_splitter splitter;
    dgfem_shelli_edit edit;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_cut(shell, desc);
    if (status) return status;
    memset(&local, 0, sizeof local);
    memset(&splitter, 0, sizeof splitter);
    memset(&edit, 0, sizeof edit);
    splitter.edit = &edit;
    splitter.desc = desc;
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    local.nodes_added = -shell->node_count;
    status = dgfem_shelli_cut_elements(&splitter, shell, &scratch, &local);
    dgfem_shelli_scratch_free(&edit.scratch);
    dgfem_shelli_scratch_free(&scratch);
    if (status) return status == DGFEM_ERROR_MEMORY ? dgfem_shelli_fail_memory(&shell->hooks) : status;
    local.nodes_added += shell->node_count;
    if (info) *info = local;
    return DGFEM_OK;
}
