#pragma once
#include "query.c"
/* Topology that changes: edges separated or turned into hinges, elements split along a plane.

   Every change builds a new topology beside the old one and takes its place only when all of it has succeeded. Middle
   nodes tell edges apart, so that separating two elements means giving one of them a middle node of its own; corners
   are doubled where the elements around them no longer hang together. */

DGFEM_API dgfem_shell_cut_desc dgfem_default_shell_cut_desc(void) {
    dgfem_shell_cut_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.plane.normal.x = 1;
    desc.current = 1;
    desc.snap = DGFEM_R(0.1);
    desc.joint = DGFEM_SHELL_GAP;
    return desc;
}

/* What a new topology is made of, and where its nodes and edges come from. */
typedef struct dgfem_shelli_edit {
    const dgfem_shell *old;
    dgfem_shelli_scratch scratch;
    dgfem_shell_element *elements;
    int element_count, element_capacity, node_count, node_capacity;
    dgfem_vec3 *rest, *position, *velocity; /* [node_capacity] */
    int *element_from;                      /* [element_capacity] the old element that an element is (a piece of) */
    int *parent;                            /* [node_capacity] the old node that a node copies, or DGFEM_NONE */
    int *on_edge;   /* [node_capacity] of a new node: the old edge that it lies on, or DGFEM_NONE */
    int *edge_from; /* [node_capacity] of a middle node: the old edge that its edge is (a part of), or DGFEM_NONE */
    char *joint;    /* [node_capacity] of a middle node: what becomes of its edge */
    int *moved_to;  /* [old nodes] of a middle node whose edge was split: the new middle node of the part it was on */
    char *to_crossing; /* [old nodes] and whether the crossing is nearer to where it was than that */
} dgfem_shelli_edit;

static dgfem_status dgfem_shelli_edit_begin(dgfem_shelli_edit *edit, const dgfem_shell *shell, int elements,
                                            int nodes) {
    memset(edit, 0, sizeof *edit);
    edit->old = shell;
    edit->scratch = dgfem_shelli_scratch_make(&shell->hooks);
    edit->element_capacity = elements;
    edit->node_capacity = nodes;
    edit->element_count = shell->element_count;
    edit->node_count = shell->node_count;
    size_t n = (size_t)nodes;
    edit->elements = (dgfem_shell_element *)dgfem_shelli_take(&edit->scratch, (size_t)elements, sizeof *edit->elements);
    edit->rest = (dgfem_vec3 *)dgfem_shelli_take(&edit->scratch, n, sizeof(dgfem_vec3));
    edit->position = (dgfem_vec3 *)dgfem_shelli_take(&edit->scratch, n, sizeof(dgfem_vec3));
    edit->velocity = (dgfem_vec3 *)dgfem_shelli_take(&edit->scratch, n, sizeof(dgfem_vec3));
    edit->element_from = (int *)dgfem_shelli_take(&edit->scratch, (size_t)elements, sizeof(int));
    edit->on_edge = (int *)dgfem_shelli_take(&edit->scratch, n, sizeof(int));
    edit->parent = (int *)dgfem_shelli_take(&edit->scratch, n, sizeof(int));
    edit->edge_from = (int *)dgfem_shelli_take(&edit->scratch, n, sizeof(int));
    edit->joint = (char *)dgfem_shelli_take(&edit->scratch, n, 1);
    edit->moved_to = (int *)dgfem_shelli_take(&edit->scratch, (size_t)shell->node_count, sizeof(int));
    edit->to_crossing = (char *)dgfem_shelli_take(&edit->scratch, (size_t)shell->node_count, 1);
    if (!edit->elements || !edit->rest || !edit->position || !edit->velocity || !edit->parent || !edit->edge_from ||
        !edit->joint || !edit->element_from || !edit->on_edge || !edit->moved_to || !edit->to_crossing)
        return DGFEM_ERROR_MEMORY;
    memcpy(edit->elements, shell->elements, (size_t)shell->element_count * sizeof *edit->elements);
    memcpy(edit->rest, shell->rest, dgfem_shelli_bytes(shell));
    memcpy(edit->position, shell->position, dgfem_shelli_bytes(shell));
    memcpy(edit->velocity, shell->velocity, dgfem_shelli_bytes(shell));
    for (int i = 0; i < nodes; i++) {
        edit->parent[i] = i < shell->node_count ? i : DGFEM_NONE;
        edit->edge_from[i] = edit->on_edge[i] = DGFEM_NONE;
    }
    for (int i = 0; i < shell->node_count; i++) edit->moved_to[i] = DGFEM_NONE;
    for (int e = 0; e < shell->element_count; e++) edit->element_from[e] = e;
    for (int i = 0; i < shell->edge_count; i++) {
        edit->edge_from[shell->edges[i].node[2]] = i;
        edit->joint[shell->edges[i].node[2]] = (char)shell->edges[i].joint;
    }
    return DGFEM_OK;
}

static int dgfem_shelli_edit_node(dgfem_shelli_edit *edit, dgfem_vec3 rest, dgfem_vec3 position, dgfem_vec3 velocity) {
    DGFEM_ASSERT(edit->node_count < edit->node_capacity);
    int i = edit->node_count++;
    edit->rest[i] = rest, edit->position[i] = position, edit->velocity[i] = velocity;
    edit->parent[i] = edit->edge_from[i] = edit->on_edge[i] = DGFEM_NONE;
    edit->joint[i] = DGFEM_SHELL_GLUED;
    return i;
}

static int dgfem_shelli_edit_copy(dgfem_shelli_edit *edit, int node) {
    int i = dgfem_shelli_edit_node(edit, edit->rest[node], edit->position[node], edit->velocity[node]);
    edit->parent[i] = edit->parent[node];
    edit->edge_from[i] = edit->edge_from[node];
    edit->on_edge[i] = edit->on_edge[node];
    edit->joint[i] = edit->joint[node];
    return i;
}

/* ---- separating ---- */

static int dgfem_shelli_root(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Elements as seen from their corners: number 4 e + k. Those joined around a node, through edges that are no gaps,
   become one class. side_of[] ends as the last side 4 e + k at each middle node. */
static void dgfem_shelli_join_corners(const dgfem_shelli_edit *edit, int *class_of, int *side_of) {
    for (int i = 0; i < 4 * edit->element_count; i++) class_of[i] = i;
    for (int i = 0; i < edit->node_count; i++) side_of[i] = DGFEM_NONE;
    for (int e = 0; e < edit->element_count; e++) {
        const dgfem_shell_element *element = &edit->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            int middle = element->node[corners + k], other = side_of[middle];
            side_of[middle] = 4 * e + k;
            if (other == DGFEM_NONE || edit->joint[middle] == DGFEM_SHELL_GAP) continue;
            int f = other / 4, l = other % 4, count = dgfem_shelli_corners(&edit->elements[f]);
            int next = 4 * e + (k + 1) % corners,
                after = 4 * f + (l + 1) % count; /* neighbours run against each other */
            class_of[dgfem_shelli_root(class_of, 4 * e + k)] = dgfem_shelli_root(class_of, after);
            class_of[dgfem_shelli_root(class_of, next)] = dgfem_shelli_root(class_of, 4 * f + l);
        }
    }
}

/* Doubles the middle nodes of gaps and the corners around which elements fall apart. Room for a copy per side and per
   corner must be there. Returns the number of edges separated, or -1 when out of memory. */
static int dgfem_shelli_edit_separate(dgfem_shelli_edit *edit) {
    int count = edit->element_count, separated = 0, nodes = edit->node_count;
    int *class_of = (int *)dgfem_shelli_take(&edit->scratch, 4 * (size_t)count, sizeof(int));
    int *side_of = (int *)dgfem_shelli_take(&edit->scratch, (size_t)edit->node_capacity, sizeof(int));
    int *owner = (int *)dgfem_shelli_take(&edit->scratch, (size_t)edit->node_capacity, sizeof(int));
    int *copy = (int *)dgfem_shelli_take(&edit->scratch, 4 * (size_t)count, sizeof(int));
    if (!class_of || !side_of || !owner || !copy) return -1;
    dgfem_shelli_join_corners(edit, class_of, side_of);
    for (int i = 0; i < nodes; i++) owner[i] = DGFEM_NONE;
    for (int i = 0; i < 4 * count; i++) copy[i] = DGFEM_NONE;
    for (int e = 0; e < count; e++) {
        dgfem_shell_element *element = &edit->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) { /* the first class around a node keeps it */
            int root = dgfem_shelli_root(class_of, 4 * e + k), node = element->node[k];
            if (owner[node] == DGFEM_NONE) owner[node] = root, copy[root] = node;
            if (copy[root] == DGFEM_NONE) copy[root] = dgfem_shelli_edit_copy(edit, node);
            element->node[k] = copy[root];
        }
        for (int k = corners; k < 2 * corners; k++) {
            int node = element->node[k];
            if (edit->joint[node] != DGFEM_SHELL_GAP || side_of[node] == 4 * e + k - corners) continue;
            element->node[k] = dgfem_shelli_edit_copy(edit, node);
            separated++;
        }
    }
    for (int i = 0; i < edit->node_count; i++)
        if (edit->joint[i] == DGFEM_SHELL_GAP) edit->joint[i] = DGFEM_SHELL_GLUED; /* boundary now */
    return separated;
}

/* ---- the new topology ---- */

/* For each old item the new ones that come from it: list[start[i]] .. list[start[i + 1] - 1]. */
typedef struct dgfem_shelli_heirs {
    int *start, *list;
} dgfem_shelli_heirs;

/* from[i]: the old item that the new item i comes from, or DGFEM_NONE. */
static int dgfem_shelli_heirs_make(dgfem_shelli_scratch *scratch, const int *from, int count, int old_count,
                                   dgfem_shelli_heirs *out) {
    out->start = (int *)dgfem_shelli_take(scratch, (size_t)old_count + 2, sizeof(int));
    out->list = (int *)dgfem_shelli_take(scratch, (size_t)count, sizeof(int));
    if (!out->start || !out->list) return 0;
    int *next = out->start + 1; /* becomes the start once its items are in */
    for (int i = 0; i < count; i++)
        if (from[i] != DGFEM_NONE) out->start[from[i] + 2]++;
    for (int i = 0; i < old_count; i++) next[i + 1] += next[i];
    for (int i = 0; i < count; i++)
        if (from[i] != DGFEM_NONE) out->list[next[from[i]]++] = i;
    return 1;
}

/* What the conditions of a new topology are found by. */
typedef struct dgfem_shelli_renewal {
    const dgfem_shelli_edit *edit;
    const dgfem_shell *next;
    dgfem_shelli_heirs nodes, on_edge, edges, elements; /* copies of nodes; new nodes on edges; and parts */
    int *load_node;                                     /* [old nodes] where forces and pins go */
    int *edge_of;                                       /* [old nodes] of middle nodes: the edge, or DGFEM_NONE */
    char *mark;                                         /* [old nodes] all 0 between uses */
} dgfem_shelli_renewal;

/* Forces and pins stay with the node's number. A middle node that has moved to a crossing passes them on to the nearest
   node on its own side of it. */
static void dgfem_shelli_find_load_nodes(const dgfem_shelli_renewal *renewal) {
    const dgfem_shelli_edit *edit = renewal->edit;
    for (int i = 0; i < edit->old->node_count; i++) renewal->load_node[i] = i;
    for (int i = 0; i < renewal->next->edge_count; i++) {
        const int *node = renewal->next->edges[i].node;
        int split = edit->on_edge[node[2]];
        if (split == DGFEM_NONE) continue;
        int middle = edit->old->edges[split].node[2];
        if (edit->moved_to[middle] != node[2]) continue;
        renewal->load_node[middle] = node[2];
        for (int a = 0; a < 2; a++)
            if (edit->to_crossing[middle] && edit->parent[node[a]] == middle) renewal->load_node[middle] = node[a];
    }
}

static int dgfem_shelli_renewal_make(dgfem_shelli_renewal *renewal, dgfem_shelli_edit *edit, const dgfem_shell *next) {
    const dgfem_shell *old = edit->old;
    dgfem_shelli_scratch *scratch = &edit->scratch;
    renewal->edit = edit;
    renewal->next = next;
    int *from = (int *)dgfem_shelli_take(scratch, (size_t)next->edge_count, sizeof(int));
    renewal->load_node = (int *)dgfem_shelli_take(scratch, (size_t)old->node_count, sizeof(int));
    renewal->edge_of = (int *)dgfem_shelli_take(scratch, (size_t)old->node_count, sizeof(int));
    renewal->mark = (char *)dgfem_shelli_take(scratch, (size_t)old->node_count, 1);
    if (!from || !renewal->load_node || !renewal->edge_of || !renewal->mark) return 0;
    for (int i = 0; i < next->edge_count; i++) from[i] = edit->edge_from[next->edges[i].node[2]];
    for (int i = 0; i < old->node_count; i++) renewal->edge_of[i] = DGFEM_NONE;
    for (int i = 0; i < old->edge_count; i++) renewal->edge_of[old->edges[i].node[2]] = i;
    dgfem_shelli_find_load_nodes(renewal);
    return dgfem_shelli_heirs_make(scratch, edit->parent, next->node_count, old->node_count, &renewal->nodes) &&
           dgfem_shelli_heirs_make(scratch, edit->on_edge, next->node_count, old->edge_count, &renewal->on_edge) &&
           dgfem_shelli_heirs_make(scratch, from, next->edge_count, old->edge_count, &renewal->edges) &&
           dgfem_shelli_heirs_make(scratch, edit->element_from, next->element_count, old->element_count,
                                   &renewal->elements);
}

/* Writes the heirs of an item, unless out is NULL. Returns how many there are. */
static int dgfem_shelli_pass_on(const dgfem_shelli_heirs *heirs, int item, int *out) {
    int count = heirs->start[item + 1] - heirs->start[item];
    if (out && count) memcpy(out, heirs->list + heirs->start[item], (size_t)count * sizeof(int));
    return count;
}

/* Fixtures hold all copies of their nodes, and what is new on edges all of whose nodes they hold. */
static int dgfem_shelli_pass_fixture(const dgfem_shelli_renewal *renewal, const char *mark, int item, int *out) {
    int edge = renewal->edge_of[item], count = dgfem_shelli_pass_on(&renewal->nodes, item, out);
    if (edge == DGFEM_NONE) return count;
    const int *node = renewal->edit->old->edges[edge].node;
    if (!mark[node[0]] || !mark[node[1]]) return count;
    return count + dgfem_shelli_pass_on(&renewal->on_edge, edge, out ? out + count : NULL);
}

/* One of the two sides of an edge that came apart keeps its load. */
static int dgfem_shelli_pass_line_load(const dgfem_shelli_renewal *renewal, int item, int *out) {
    int count = 0;
    for (int i = renewal->edges.start[item]; i < renewal->edges.start[item + 1]; i++) {
        int edge = renewal->edges.list[i], middle = renewal->next->edges[edge].node[2];
        int parent = renewal->edit->parent[middle];
        if (parent != DGFEM_NONE && parent != middle) continue;
        if (out) out[count] = edge;
        count++;
    }
    return count;
}

/* The items of a condition in the new topology. Returns their number; out may be NULL. */
static int dgfem_shelli_renew_items(const dgfem_shelli_renewal *renewal, const dgfem_shell_condition *old,
                                    const char *mark, int *out) {
    int count = 0;
    for (int i = 0; i < old->count; i++) {
        int item = old->items[i], *to = out ? out + count : NULL;
        switch (old->kind) {
        case DGFEM_SHELL_CONDITION_FIX: count += dgfem_shelli_pass_fixture(renewal, mark, item, to); break;
        case DGFEM_SHELL_CONDITION_FORCE:
        case DGFEM_SHELL_CONDITION_PIN:
            if (to) *to = renewal->load_node[item];
            count++;
            break;
        case DGFEM_SHELL_CONDITION_PRESSURE: count += dgfem_shelli_pass_on(&renewal->elements, item, to); break;
        case DGFEM_SHELL_CONDITION_LINE_LOAD: count += dgfem_shelli_pass_line_load(renewal, item, to); break;
        default: count += dgfem_shelli_pass_on(&renewal->edges, item, to);
        }
    }
    return count;
}

static dgfem_status dgfem_shelli_renew_condition(const dgfem_shelli_renewal *renewal, const dgfem_shell_condition *old,
                                                 dgfem_shell_condition *out) {
    int fixture = old->kind == DGFEM_SHELL_CONDITION_FIX;
    *out = *old;
    for (int i = 0; fixture && i < old->count; i++) renewal->mark[old->items[i]] = 1;
    out->count = dgfem_shelli_renew_items(renewal, old, renewal->mark, NULL);
    out->items = (int *)dgfem_shelli_allocate(&renewal->next->hooks, (size_t)out->count, sizeof(int));
    if (out->items) (void)dgfem_shelli_renew_items(renewal, old, renewal->mark, out->items);
    for (int i = 0; fixture && i < old->count; i++) renewal->mark[old->items[i]] = 0;
    if (!out->items) return DGFEM_ERROR_MEMORY;
    if (old->kind == DGFEM_SHELL_CONDITION_PIN) { /* its place goes with its node */
        dgfem_vec3 moved =
            dgfem_shelli_sub(renewal->next->position[out->items[0]], renewal->edit->old->position[old->items[0]]);
        out->vector = dgfem_shelli_add(out->vector, moved);
        out->vector_before = dgfem_shelli_add(out->vector_before, moved);
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_renew_conditions(dgfem_shelli_edit *edit, dgfem_shell *next) {
    const dgfem_shell *old = edit->old;
    dgfem_shelli_renewal renewal;
    next->condition_count = 0;
    next->conditions = (dgfem_shell_condition *)dgfem_shelli_allocate(&next->hooks, (size_t)old->condition_capacity,
                                                                      sizeof *next->conditions);
    if (!next->conditions || !dgfem_shelli_renewal_make(&renewal, edit, next)) return DGFEM_ERROR_MEMORY;
    for (int c = 0; c < old->condition_count; c++) {
        dgfem_status status = dgfem_shelli_renew_condition(&renewal, &old->conditions[c], &next->conditions[c]);
        if (status) return status;
        next->condition_count++;
    }
    return DGFEM_OK;
}

static void dgfem_shelli_free_conditions(dgfem_shell *shell) {
    for (int c = 0; c < shell->condition_count; c++) dgfem_shelli_free(&shell->hooks, shell->conditions[c].items);
    dgfem_shelli_free(&shell->hooks, shell->conditions);
}

static dgfem_status dgfem_shelli_edit_build(dgfem_shelli_edit *edit, dgfem_shell *next) {
    next->element_count = edit->element_count;
    next->node_count = edit->node_count;
    if (!dgfem_shelli_allocate_elements(next) || !dgfem_shelli_allocate_nodes(next)) return DGFEM_ERROR_MEMORY;
    memcpy(next->elements, edit->elements, (size_t)next->element_count * sizeof *next->elements);
    memcpy(next->rest, edit->rest, dgfem_shelli_bytes(next));
    memcpy(next->position, edit->position, dgfem_shelli_bytes(next));
    memcpy(next->velocity, edit->velocity, dgfem_shelli_bytes(next));
    dgfem_status status = dgfem_shelli_connect(next);
    if (!status) status = dgfem_shelli_measure(next);
    if (status) return status;
    for (int i = 0; i < next->edge_count; i++)
        if (!dgfem_shelli_is_boundary(&next->edges[i]))
            next->edges[i].joint = (dgfem_shell_joint)edit->joint[next->edges[i].node[2]];
    status = dgfem_shelli_system_create(next);
    return status ? status : dgfem_shelli_renew_conditions(edit, next);
}

/* Separates the gaps, builds the new topology and puts it in the shell's place. *separated: edges that came apart. */
static dgfem_status dgfem_shelli_edit_commit(dgfem_shelli_edit *edit, dgfem_shell *shell, int *separated) {
    dgfem_shell next = *shell;
    *separated = dgfem_shelli_edit_separate(edit);
    if (*separated < 0) return DGFEM_ERROR_MEMORY;
    next.rest = next.position = next.velocity = NULL;
    next.node_area = next.node_mass = next.node_load = next.node_half = next.node_spring = NULL;
    next.elements = NULL;
    next.edges = NULL;
    next.system = NULL;
    next.conditions = NULL;
    next.condition_count = 0;
    dgfem_status status = dgfem_shelli_edit_build(edit, &next);
    if (status) {
        dgfem_shelli_free_topology(&next);
        dgfem_shelli_free_conditions(&next);
        return status;
    }
    dgfem_shelli_free_topology(shell);
    dgfem_shelli_free_conditions(shell);
    *shell = next;
    shell->revision++;
    dgfem_shelli_refresh_edges(shell);
    return DGFEM_OK;
}

/* ---- cuts along edges ---- */

DGFEM_API dgfem_status dgfem_shell_cut_edges(dgfem_shell *shell, const int *edges, int count, dgfem_shell_joint joint) {
    dgfem_shelli_edit edit;
    int separated, changed = 0;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, edges, count, shell->edge_count, "edge");
    for (int i = 0; !status && i < count; i++)
        if (dgfem_shelli_is_boundary(&shell->edges[edges[i]]))
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "edge %d is on the boundary", edges[i]);
    if (!status && ((int)joint < 0 || joint > DGFEM_SHELL_GAP))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "unknown joint %d", (int)joint);
    for (int i = 0; !status && i < count; i++) changed += shell->edges[edges[i]].joint != joint;
    if (status || !changed) return status;
    status = dgfem_shelli_edit_begin(&edit, shell, shell->element_count, shell->node_count + 8 * shell->element_count);
    for (int i = 0; !status && i < count; i++) edit.joint[shell->edges[edges[i]].node[2]] = (char)joint;
    if (!status) status = dgfem_shelli_edit_commit(&edit, shell, &separated);
    dgfem_shelli_scratch_free(&edit.scratch);
    return status == DGFEM_ERROR_MEMORY ? dgfem_shelli_fail_memory(&shell->hooks) : status;
}

/* ---- pieces ---- */

/* class_of and number have room for all elements; number[root of class_of] becomes the piece. */
static int dgfem_shelli_count_pieces(const dgfem_shell *shell, int *class_of, int *number) {
    int count = 0;
    for (int e = 0; e < shell->element_count; e++) class_of[e] = e, number[e] = DGFEM_NONE;
    for (int i = 0; i < shell->edge_count; i++)
        if (!dgfem_shelli_is_boundary(&shell->edges[i]))
            class_of[dgfem_shelli_root(class_of, shell->edges[i].element[0])] =
                dgfem_shelli_root(class_of, shell->edges[i].element[1]);
    for (int e = 0; e < shell->element_count; e++) {
        int root = dgfem_shelli_root(class_of, e);
        if (number[root] == DGFEM_NONE) number[root] = count++;
    }
    return count;
}

DGFEM_API dgfem_status dgfem_shell_pieces(const dgfem_shell *shell, int *count, int *piece) {
    if (!shell || !count) return DGFEM_ERROR_ARGUMENT;
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    int *class_of = (int *)dgfem_shelli_take(&scratch, (size_t)shell->element_count, sizeof(int));
    int *number = (int *)dgfem_shelli_take(&scratch, (size_t)shell->element_count, sizeof(int));
    if (!class_of || !number) {
        dgfem_shelli_scratch_free(&scratch);
        return dgfem_shelli_fail_memory(&shell->hooks);
    }
    *count = dgfem_shelli_count_pieces(shell, class_of, number);
    for (int e = 0; piece && e < shell->element_count; e++) piece[e] = number[dgfem_shelli_root(class_of, e)];
    dgfem_shelli_scratch_free(&scratch);
    return DGFEM_OK;
}
