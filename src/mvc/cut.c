#pragma once
#include "sliver.c"
/* Cuts of meshes and bodies. */

/* ---- blades ---- */

static void dgfem_mvci_blade_axes(dgfem_mvci_blade *blade, dgfem_vec3 normal, dgfem_vec3 origin) {
    dgfem_real ax = dgfem_mvci_abs(normal.x), ay = dgfem_mvci_abs(normal.y), az = dgfem_mvci_abs(normal.z);
    dgfem_vec3 axis = dgfem_mvci_vec3(ax <= ay && ax <= az, ay < ax && ay <= az, az < ax && az < ay);
    blade->plane.normal = normal;
    blade->plane.offset = dgfem_mvci_dot(normal, origin);
    blade->origin = origin;
    blade->u = dgfem_mvci_unit(dgfem_mvci_cross(axis, normal));
    blade->v = dgfem_mvci_cross(normal, blade->u);
}

/* The polygon of `count` points becomes counter-clockwise in the blade's coordinates. 0 when out of memory, -1 where it
   has no area. */
static int dgfem_mvci_blade_set(const dgfem_hooks *hooks, dgfem_mvci_blade *blade, const dgfem_vec3 *points,
                                int count) {
    dgfem_vec3 area = dgfem_mvci_vec3(0, 0, 0), middle = area;
    dgfem_real longest = 0;
    for (int i = 0; i < count; i++) {
        middle = dgfem_mvci_axpy(middle, 1 / (dgfem_real)count, points[i]);
        longest = dgfem_mvci_max(longest, dgfem_mvci_distance(points[0], points[i]));
        if (i < 2) continue;
        area = dgfem_mvci_add(
            area, dgfem_mvci_cross(dgfem_mvci_sub(points[i - 1], points[0]), dgfem_mvci_sub(points[i], points[0])));
    }
    if (!(dgfem_mvci_norm(area) > (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9)) * longest * longest)) return -1;
    dgfem_mvci_blade_axes(blade, dgfem_mvci_unit(area), middle);
    blade->polygon.count = 0;
    for (int i = 0; i < count; i++) {
        double p[2];
        dgfem_mvci_blade_place(blade, points[i], p);
        if (!dgfem_mvci_points_push(hooks, &blade->polygon, p[0], p[1])) return 0;
    }
    return 1;
}

/* ---- attempts ---- */

/* Whether a blade meets anything. Negative when out of memory. */
static int dgfem_mvci_blade_meets(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                  int open, dgfem_mvci_cracks *cracks) {
    if (!dgfem_mvci_select(s, mesh, blade)) return -1;
    if (s->selected.count || !open) return s->selected.count > 0;
    return dgfem_mvci_find_blade_faces(s, mesh, cracks) ? cracks->faces.count > 0 : -1;
}

/* Repeats attempts until one succeeds: at the latest when all elements are sealed, for then nothing is changed. */
static dgfem_status dgfem_mvci_try_cuts(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                        int open, dgfem_mvci_cracks *cracks, dgfem_mvci_mesh **out) {
    for (int attempt = 0;; attempt++) {
        dgfem_mvci_mesh *copy = dgfem_mvci_mesh_copy(mesh);
        dgfem_status status = copy ? dgfem_mvci_cut_attempt(s, copy, blade, open, cracks) : DGFEM_ERROR_MEMORY;
        for (int e = 0; !status && e < mesh->element_count; e++) copy->elements[e].changed |= mesh->elements[e].changed;
        if (!status && !dgfem_mvci_mesh_compact(copy)) status = DGFEM_ERROR_MEMORY;
        if (!status) *out = copy;
        else dgfem_mvci_mesh_destroy(copy);
        if (status != DGFEM_ERROR_DEGENERATE) return status;
        int learned = dgfem_mvci_splitter_learn(s, attempt);
        if (learned <= 0) return learned ? DGFEM_ERROR_MEMORY : status;
    }
}

/* Cuts a mesh, or splits its elements where not `open`. *out is what becomes of it, NULL where nothing does. */
static dgfem_status dgfem_mvci_mesh_cut(const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade, int current,
                                        dgfem_real snap, int open, dgfem_mvc_cut_info *info, dgfem_mvci_mesh **out) {
    dgfem_mvci_splitter splitter;
    dgfem_mvci_cracks cracks;
    dgfem_status status = DGFEM_OK;
    *out = NULL;
    memset(&cracks, 0, sizeof cracks);
    int meets = dgfem_mvci_splitter_make(&splitter, &mesh->hooks, mesh, blade->plane, current, snap) ? 0 : -1;
    if (!meets) meets = dgfem_mvci_blade_meets(&splitter, mesh, blade, open, &cracks);
    if (meets < 0) status = DGFEM_ERROR_MEMORY;
    if (meets > 0) status = dgfem_mvci_try_cuts(&splitter, mesh, blade, open, &cracks, out);
    if (!status) info->elements_kept += splitter.elements_kept;
    if (*out && !splitter.elements_split && !splitter.nodes_added && !cracks.faces.count) {
        dgfem_mvci_mesh_destroy(*out);
        *out = NULL;
    }
    if (*out) {
        info->elements_split += splitter.elements_split;
        info->nodes_added += splitter.nodes_added;
        info->nodes_copied += cracks.nodes_copied;
        info->faces_cut += cracks.faces.count;
    }
    dgfem_mvci_cracks_free(&mesh->hooks, &cracks);
    dgfem_mvci_splitter_free(&splitter);
    return status;
}

/* ---- pieces ---- */

/* piece_of[element_count], numbered in the order of their first elements. Returns their number, -1 when out of
   memory. */
static int dgfem_mvci_mesh_pieces(const dgfem_mvci_mesh *mesh, int *piece_of) {
    int *root = (int *)dgfem_mvci_allocate(&mesh->hooks, (size_t)mesh->element_count, sizeof(int)), count = 0;
    if (!root) return -1;
    for (int e = 0; e < mesh->element_count; e++) root[e] = e;
    for (int f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].owner[1] != DGFEM_NONE)
            dgfem_mvci_join(root, mesh->faces[f].owner[0], mesh->faces[f].owner[1]);
    for (int e = 0; e < mesh->element_count; e++) {
        int first = dgfem_mvci_root(root, e); /* the lowest of its class */
        piece_of[e] = first == e ? count++ : piece_of[first];
    }
    dgfem_mvci_free(&mesh->hooks, root);
    return count;
}

/* Sums over nodes; `centre` is sum m x and `spin` the angular momentum about the origin until the end. */
static void dgfem_mvci_piece_add(const dgfem_mvc *body, int node, dgfem_piece *piece) {
    dgfem_vec3 x = body->position[node], p = dgfem_mvci_scale(body->mass[node], body->velocity[node]);
    piece->mass += body->mass[node];
    piece->centre = dgfem_mvci_axpy(piece->centre, body->mass[node], x);
    piece->momentum = dgfem_mvci_add(piece->momentum, p);
    piece->spin = dgfem_mvci_add(piece->spin, dgfem_mvci_cross(x, p));
}

/* `seen` has a zero for each node. */
static void dgfem_mvci_measure_pieces(const dgfem_mvc *body, const int *piece_of, char *seen, dgfem_piece *pieces,
                                      int room) {
    memset(pieces, 0, (size_t)room * sizeof *pieces);
    for (int e = 0; e < body->element_count; e++) {
        int face_count;
        const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
        if (piece_of[e] >= room) continue;
        pieces[piece_of[e]].element_count++;
        pieces[piece_of[e]].volume += body->volume[e];
        for (int k = 0; k < face_count; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(body->mesh, faces[k] / 2, &count);
            for (int i = 0; i < count; i++)
                if (!seen[loop[i]]) dgfem_mvci_piece_add(body, loop[i], &pieces[piece_of[e]]), seen[loop[i]] = 1;
        }
    }
    for (int k = 0; k < room; k++) {
        pieces[k].centre = dgfem_mvci_scale(1 / pieces[k].mass, pieces[k].centre);
        pieces[k].spin = dgfem_mvci_sub(pieces[k].spin, dgfem_mvci_cross(pieces[k].centre, pieces[k].momentum));
    }
}

DGFEM_API dgfem_status dgfem_mvc_pieces(const dgfem_mvc *body, int *piece_of, dgfem_piece *pieces, int capacity,
                                        int *count) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!count || capacity < 0)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "pieces: room for %d, or no count", capacity);
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    int *own = (int *)dgfem_mvci_take(&scratch, (size_t)body->element_count, sizeof(int));
    char *seen = (char *)dgfem_mvci_take(&scratch, (size_t)body->node_count, 1);
    int found = own && seen ? dgfem_mvci_mesh_pieces(body->mesh, own) : -1;
    if (found >= 0) {
        int room = pieces ? (found < capacity ? found : capacity) : 0;
        *count = found;
        if (piece_of) memcpy(piece_of, own, (size_t)body->element_count * sizeof(int));
        if (room) dgfem_mvci_measure_pieces(body, own, seen, pieces, room);
    }
    dgfem_mvci_scratch_free(&scratch);
    return found >= 0 ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
}

DGFEM_API dgfem_real dgfem_mvc_quality(const dgfem_mvc *body, int element) {
    if (!body || element < 0 || element >= body->element_count) return 0;
    return dgfem_mvci_element_quality(body->mesh, element);
}

DGFEM_API int dgfem_mvc_face_is_wall(const dgfem_mvc *body, int face) {
    if (!body || face < 0 || face >= body->face_count) return 0;
    return body->mesh->faces[face].wall && body->mesh->faces[face].owner[1] == DGFEM_NONE;
}

/* ---- cuts of a body ---- */

/* A mesh that cuts replace, and what is needed to tell of new pieces. */
typedef struct dgfem_mvci_job {
    dgfem_mvc *body;
    const dgfem_mvc_cut_desc *desc;
    dgfem_real snap;
    dgfem_mvci_mesh *mesh; /* NULL: that of the body still */
    dgfem_mvci_blade blade;
    dgfem_mvc_cut_info info;
    dgfem_mvci_scratch scratch;
    int *old_piece;     /* [new elements] piece before */
    int *piece;         /* [new elements] */
    int *largest;       /* [pieces before] largest of the pieces that it has become */
    int *elements;      /* of one piece */
    dgfem_real *volume; /* [new pieces] */
} dgfem_mvci_job;

static dgfem_status dgfem_mvci_job_blade(dgfem_mvci_job *job, int open) {
    const dgfem_mvci_mesh *mesh = job->mesh ? job->mesh : job->body->mesh;
    dgfem_mvci_mesh *next;
    dgfem_status status =
        dgfem_mvci_mesh_cut(mesh, &job->blade, job->desc->current, job->snap, open, &job->info, &next);
    if (!next) return status;
    dgfem_mvci_mesh_destroy(job->mesh);
    job->mesh = next;
    return status;
}

/* Numbers the pieces before the body takes over the new mesh, so that nothing can fail afterwards. */
static dgfem_status dgfem_mvci_job_pieces(dgfem_mvci_job *job) {
    size_t old_count = (size_t)job->body->element_count, count = (size_t)job->mesh->element_count;
    int *before = (int *)dgfem_mvci_take(&job->scratch, old_count, sizeof(int));
    job->old_piece = (int *)dgfem_mvci_take(&job->scratch, count, sizeof(int));
    job->piece = (int *)dgfem_mvci_take(&job->scratch, count, sizeof(int));
    job->largest = (int *)dgfem_mvci_take(&job->scratch, old_count, sizeof(int));
    job->elements = (int *)dgfem_mvci_take(&job->scratch, count, sizeof(int));
    job->volume = (dgfem_real *)dgfem_mvci_take(&job->scratch, count, sizeof(dgfem_real));
    if (!before || !job->old_piece || !job->piece || !job->largest || !job->elements || !job->volume ||
        dgfem_mvci_mesh_pieces(job->body->mesh, before) < 0)
        return DGFEM_ERROR_MEMORY;
    job->info.pieces = dgfem_mvci_mesh_pieces(job->mesh, job->piece);
    if (job->info.pieces < 0) return DGFEM_ERROR_MEMORY;
    for (int e = 0; e < job->mesh->element_count; e++) {
        dgfem_vec3 centre;
        job->old_piece[e] = before[job->mesh->elements[e].from];
        job->volume[job->piece[e]] += dgfem_mvci_element_measure(job->mesh, e, &centre);
    }
    for (int i = 0; i < job->body->element_count; i++) job->largest[i] = DGFEM_NONE;
    for (int e = 0; e < job->mesh->element_count; e++) {
        int *largest = &job->largest[job->old_piece[e]];
        if (*largest == DGFEM_NONE || job->volume[job->piece[e]] > job->volume[*largest]) *largest = job->piece[e];
    }
    return DGFEM_OK;
}

static void dgfem_mvci_job_tell(const dgfem_mvci_job *job) {
    for (int k = 0; job->desc->new_piece && k < job->info.pieces; k++) {
        int count = 0, is_new = 0;
        for (int e = 0; e < job->body->element_count; e++) {
            if (job->piece[e] != k) continue;
            is_new = job->largest[job->old_piece[e]] != k;
            job->elements[count++] = e;
        }
        if (is_new) job->desc->new_piece(job->desc->new_piece_user, job->body, k, job->elements, count);
    }
}

static dgfem_mvci_job dgfem_mvci_job_make(dgfem_mvc *body, const dgfem_mvc_cut_desc *desc) {
    dgfem_mvci_job job;
    memset(&job, 0, sizeof job);
    job.body = body, job.desc = desc;
    job.snap = desc->snap;
    job.scratch = dgfem_mvci_scratch_make(&body->hooks);
    return job;
}

/* Removes slivers, gives the mesh to the body, tells of new pieces; frees what the job has. `all`: slivers everywhere,
   else of what has changed. Logs a failure. */
static dgfem_status dgfem_mvci_job_end(dgfem_mvci_job *job, dgfem_status status, int all, dgfem_mvc_cut_info *info) {
    dgfem_mvc *body = job->body;
    if (!status && all && !job->mesh) {
        job->mesh = dgfem_mvci_mesh_copy(body->mesh);
        if (!job->mesh) status = DGFEM_ERROR_MEMORY;
    }
    if (!status && job->mesh && job->desc->remove_slivers)
        status = dgfem_mvci_mesh_remove_slivers(&job->mesh, job->desc->quality, all, &job->info.slivers_removed,
                                                &job->info.slivers_left);
    int changed = job->info.elements_split || job->info.nodes_added || job->info.faces_cut || job->info.slivers_removed;
    if (!status && job->mesh) status = dgfem_mvci_job_pieces(job);
    if (status == DGFEM_ERROR_MEMORY) (void)dgfem_mvci_fail_memory(&body->hooks);
    if (status == DGFEM_ERROR_DEGENERATE)
        (void)dgfem_mvci_fail(&body->hooks, status,
                              "cut: no way to cut the elements here leaves all of them star-shaped");
    if (!status && job->mesh && changed) {
        status = dgfem_mvci_body_accept_mesh(body, job->mesh);
        if (!status) job->mesh = NULL;
        if (!status) dgfem_mvci_job_tell(job);
    }
    if (!status && !job->info.pieces) status = dgfem_mvc_pieces(body, NULL, NULL, 0, &job->info.pieces);
    if (!status && info) *info = job->info;
    dgfem_mvci_mesh_destroy(job->mesh);
    dgfem_mvci_blade_free(&body->hooks, &job->blade);
    dgfem_mvci_scratch_free(&job->scratch);
    return status;
}

/* ---- public ---- */

DGFEM_API dgfem_mvc_cut_desc dgfem_default_mvc_cut_desc(void) {
    dgfem_mvc_cut_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.current = 1;
    desc.snap = DGFEM_R(0.05);
    desc.remove_slivers = 1;
    desc.quality = DGFEM_R(0.02);
    return desc;
}

static dgfem_status dgfem_mvci_check_cut(const dgfem_mvc *body, const dgfem_mvc_cut_desc *desc) {
    if (desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    if (!(desc->snap >= 0 && desc->snap < DGFEM_R(0.5)))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: snap %g is not in [0, 0.5)",
                               (double)desc->snap);
    if (!(desc->quality >= 0 && desc->quality < DGFEM_R(0.2)))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: quality %g is not in [0, 0.2)",
                               (double)desc->quality);
    return DGFEM_OK;
}

/* element: the only one to be split, or DGFEM_NONE. */
static dgfem_status dgfem_mvci_body_plane(dgfem_mvc *body, int element, dgfem_plane plane,
                                          const dgfem_mvc_cut_desc *desc, int open, dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc standard = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    dgfem_status status = dgfem_mvci_check_cut(body, desc);
    if (status) return status;
    if (!dgfem_mvci_is_finite3(plane.normal) || !dgfem_mvci_is_finite(plane.offset))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: the plane");
    dgfem_real length = dgfem_mvci_norm(plane.normal);
    if (!(length > 0)) return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: the plane's normal is zero");
    if (!dgfem_mvci_is_finite(length))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: the length of the plane's normal");
    dgfem_mvci_job job = dgfem_mvci_job_make(body, desc);
    dgfem_vec3 normal = dgfem_mvci_scale(1 / length, plane.normal);
    dgfem_mvci_blade_axes(&job.blade, normal, dgfem_mvci_scale(plane.offset / length, normal));
    job.blade.single = element != DGFEM_NONE;
    job.blade.element = element;
    status = dgfem_mvci_job_blade(&job, open);
    return dgfem_mvci_job_end(&job, status, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_split_element(dgfem_mvc *body, int element, dgfem_plane plane,
                                               const dgfem_mvc_cut_desc *desc, dgfem_mvc_cut_info *info) {
    if (info) memset(info, 0, sizeof *info);
    if (body && (element < 0 || element >= body->element_count))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "split: there is no element %d", element);
    return dgfem_mvci_body_plane(body, element, plane, desc, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_split_plane(dgfem_mvc *body, dgfem_plane plane, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info) {
    return dgfem_mvci_body_plane(body, DGFEM_NONE, plane, desc, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_cut_plane(dgfem_mvc *body, dgfem_plane plane, const dgfem_mvc_cut_desc *desc,
                                           dgfem_mvc_cut_info *info) {
    return dgfem_mvci_body_plane(body, DGFEM_NONE, plane, desc, 1, info);
}

/* Points that exist and are finite. */
static dgfem_status dgfem_mvci_check_blade_points(const dgfem_mvc *body, const dgfem_points_in *points) {
    dgfem_status status = dgfem_mvci_check_points(&body->hooks, points, "cut");
    for (int i = 0; !status && i < points->count; i++)
        if (!dgfem_mvci_is_finite3(dgfem_mvci_read_point(points, i)))
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: point %d", i);
    return status;
}

/* Whether the blade's polygon crosses or touches itself, at which side. */
static int dgfem_mvci_blade_crosses(const dgfem_mvci_blade *blade, int *side) {
    const dgfem_mvci_points *polygon = &blade->polygon;
    int n = polygon->count;
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            const double *a = polygon->at[i], *b = polygon->at[(i + 1) % n], *c = polygon->at[j];
            const double *d = polygon->at[(j + 1) % n];
            *side = j;
            if (j == i + 1 || (!i && j == n - 1)) continue;
            double ta = dgfem_mvci_turn(c, d, a), tb = dgfem_mvci_turn(c, d, b);
            double tc = dgfem_mvci_turn(a, b, c), td = dgfem_mvci_turn(a, b, d);
            if (((ta >= 0 && tb <= 0) || (ta <= 0 && tb >= 0)) && ((tc >= 0 && td <= 0) || (tc <= 0 && td >= 0)) &&
                (ta != 0 || tb != 0))
                return 1;
        }
    return 0;
}

/* job->blade from the points; refuses what is no plane polygon. */
static dgfem_status dgfem_mvci_job_polygon(dgfem_mvci_job *job, const dgfem_vec3 *points, int count) {
    const dgfem_hooks *hooks = &job->body->hooks;
    dgfem_real size = 0;
    int side, made = dgfem_mvci_blade_set(hooks, &job->blade, points, count);
    if (!made) return dgfem_mvci_fail_memory(hooks);
    if (made < 0) return dgfem_mvci_fail(hooks, DGFEM_ERROR_DEGENERATE, "cut: the polygon has no area");
    for (int i = 0; i < count; i++)
        size = dgfem_mvci_max(size, dgfem_mvci_norm(dgfem_mvci_sub(points[i], job->blade.origin)));
    for (int i = 0; i < count; i++) {
        dgfem_real off = dgfem_mvci_dot(job->blade.plane.normal, dgfem_mvci_sub(points[i], job->blade.origin));
        if (dgfem_mvci_abs(off) > size * (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-6)))
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_PLANAR, "cut: point %d of the polygon is %g off its plane", i,
                                   (double)off);
    }
    if (dgfem_mvci_blade_crosses(&job->blade, &side))
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_SIMPLE, "cut: side %d of the polygon crosses another", side);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_cut_polygon(dgfem_mvc *body, dgfem_points_in polygon, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc standard = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    dgfem_status status = dgfem_mvci_check_cut(body, desc);
    if (!status) status = dgfem_mvci_check_blade_points(body, &polygon);
    if (status) return status;
    if (polygon.count < 3)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: a polygon of %d points", polygon.count);
    dgfem_vec3 *points = (dgfem_vec3 *)dgfem_mvci_allocate(&body->hooks, (size_t)polygon.count, sizeof(dgfem_vec3));
    if (!points) return dgfem_mvci_fail_memory(&body->hooks);
    for (int i = 0; i < polygon.count; i++) points[i] = dgfem_mvci_read_point(&polygon, i);
    dgfem_mvci_job job = dgfem_mvci_job_make(body, desc);
    status = dgfem_mvci_job_polygon(&job, points, polygon.count);
    if (status) dgfem_mvci_blade_free(&body->hooks, &job.blade);
    dgfem_mvci_free(&body->hooks, points);
    if (status) return status;
    status = dgfem_mvci_job_blade(&job, 1);
    return dgfem_mvci_job_end(&job, status, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_cut_surface(dgfem_mvc *body, dgfem_points_in vertices, const int *triangles,
                                             int triangle_count, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc standard = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    dgfem_status status = dgfem_mvci_check_cut(body, desc);
    if (!status) status = dgfem_mvci_check_blade_points(body, &vertices);
    if (status) return status;
    if (triangle_count < 0 || (triangle_count && !triangles))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: no indices for %d triangles", triangle_count);
    for (int i = 0; i / 3 < triangle_count; i++)
        if (triangles[i] < 0 || triangles[i] >= vertices.count)
            return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "cut: triangle %d has the vertex %d", i / 3,
                                   triangles[i]);
    dgfem_mvci_job job = dgfem_mvci_job_make(body, desc);
    job.snap = 0; /* the least: else cuts along neighbouring triangles would miss each other */
    for (int t = 0; !status && t < triangle_count; t++) {
        dgfem_vec3 corner[3];
        for (int i = 0; i < 3; i++) corner[i] = dgfem_mvci_read_point(&vertices, triangles[3 * t + i]);
        int made = dgfem_mvci_blade_set(&body->hooks, &job.blade, corner, 3);
        if (!made) status = DGFEM_ERROR_MEMORY;
        if (made > 0) status = dgfem_mvci_job_blade(&job, 1); /* a triangle without area cuts nothing */
    }
    return dgfem_mvci_job_end(&job, status, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_remove_slivers(dgfem_mvc *body, dgfem_real quality, dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    desc.quality = quality;
    dgfem_status status = dgfem_mvci_check_cut(body, &desc);
    if (status) return status;
    dgfem_mvci_job job = dgfem_mvci_job_make(body, &desc);
    return dgfem_mvci_job_end(&job, DGFEM_OK, 1, info);
}
