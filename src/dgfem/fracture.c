#pragma once
#include "refine.c"
/* Fracture: glue breaks where the traction on it exceeds what the material bears.

   All tractions are those of the body as it is when the call begins; what breaks does not relieve the others until the
   next step or solve. Hence the order: the most overloaded first, and max_breaks. */

typedef struct dgfemi_overload {
    dgfem_real ratio; /* of traction to strength */
    int item;         /* a face, or an element */
} dgfemi_overload;

typedef struct dgfemi_fracturer {
    const dgfem_body *body;
    const dgfem_fracture_desc *desc;
    dgfemi_edit *edit;
    dgfemi_overload *list;
    int count;
    char *touched; /* [elements of the body] 1: a face of it has broken in this call */
    dgfem_fracture_info *info;
} dgfemi_fracturer;

static dgfem_real dgfemi_fracture_strength(const dgfem_fracture_desc *desc, int element) {
    return desc->strengths ? desc->strengths[element] : desc->strength;
}

/* The largest first; equal ones by index, so that the result does not depend on the sort. */
static int dgfemi_overload_compare(const void *a, const void *b) {
    const dgfemi_overload *p = (const dgfemi_overload *)a, *q = (const dgfemi_overload *)b;
    if (p->ratio > q->ratio || p->ratio < q->ratio) return p->ratio > q->ratio ? -1 : 1;
    return (p->item > q->item) - (p->item < q->item);
}

/* ---- faces ---- */

/* What a face's two sides have in common, for tractions at its points. */
typedef struct dgfemi_glue {
    const dgfem_face *face;
    dgfem_vec3 side_normal[2]; /* turned with each element */
    dgfem_vec3 normal;         /* of both, in the world */
} dgfemi_glue;

static dgfemi_glue dgfemi_glue_make(const dgfem_body *body, const dgfem_face *face) {
    dgfemi_glue glue;
    glue.face = face;
    for (int s = 0; s < 2; s++) {
        dgfem_mat3 r = dgfemi_rotation_now(body, face->element[s]);
        glue.side_normal[s] = dgfemi_multiply(&r, face->normal);
    }
    glue.normal = dgfemi_normalized(dgfemi_add(glue.side_normal[0], glue.side_normal[1]));
    return glue;
}

static dgfem_vec3 dgfemi_glue_traction(const dgfem_body *body, const dgfemi_glue *glue, dgfem_vec3 x) {
    dgfem_vec3 traction = dgfemi_vec3(0, 0, 0);
    for (int s = 0; s < 2; s++) {
        int e = glue->face->element[s];
        dgfem_mat3 f = dgfemi_gradient(body, e, x), stress = dgfemi_stress_of(body, e, &f);
        traction = dgfemi_add_scaled(traction, DGFEM_R(0.5), dgfemi_multiply(&stress, glue->side_normal[s]));
    }
    return traction;
}

/* The largest normal traction at the face's vertices and centre. */
static dgfem_real dgfemi_glue_peak(const dgfem_body *body, const dgfemi_glue *glue) {
    const dgfem_mesh *mesh = body->mesh;
    const dgfem_face *face = glue->face;
    dgfem_real peak = dgfemi_dot(glue->normal, dgfemi_glue_traction(body, glue, face->centre));
    if (body->degree[face->element[0]] == 1 && body->degree[face->element[1]] == 1)
        return peak; /* the same everywhere */
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 x = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            peak = dgfemi_max(peak, dgfemi_dot(glue->normal, dgfemi_glue_traction(body, glue, x)));
        }
    return peak;
}

/* Energy per area that opening the face releases. */
static dgfem_real dgfemi_glue_release(const dgfem_body *body, const dgfemi_glue *glue, int f) {
    dgfem_vec3 traction = dgfemi_glue_traction(body, glue, glue->face->centre);
    dgfem_real along = dgfemi_dot(glue->normal, traction), release = 0;
    dgfem_vec3 shear = dgfemi_add_scaled(traction, -along, glue->normal);
    for (int s = 0; s < 2; s++) {
        int e = glue->face->element[s];
        dgfem_real density = along * along / (2 * body->material[e].young) +
                             dgfemi_dot(shear, shear) / (2 * dgfemi_mu(&body->material[e]));
        release += density * body->mesh->elements[e].volume / dgfemi_patch_area(body->mesh, e, f);
    }
    return release;
}

static void dgfemi_fracture_list_faces(dgfemi_fracturer *fracturer) {
    const dgfem_body *body = fracturer->body;
    const dgfem_fracture_desc *desc = fracturer->desc;
    fracturer->count = 0;
    for (int f = 0; f < body->mesh->face_count; f++) {
        const dgfem_face *face = &body->mesh->faces[f];
        if (!dgfemi_face_is_glued(face)) continue;
        dgfem_real strength = dgfemi_min(dgfemi_fracture_strength(desc, face->element[0]),
                                         dgfemi_fracture_strength(desc, face->element[1]));
        dgfemi_glue glue = dgfemi_glue_make(body, face);
        dgfem_real ratio = dgfemi_glue_peak(body, &glue) / strength;
        fracturer->info->largest_ratio = dgfemi_max(ratio, fracturer->info->largest_ratio);
        if (!(ratio >= 1)) continue;
        if (desc->toughness > 0 && !(dgfemi_glue_release(body, &glue, f) >= desc->toughness)) continue;
        fracturer->list[fracturer->count].ratio = ratio;
        fracturer->list[fracturer->count++].item = f;
    }
    qsort(fracturer->list, (size_t)fracturer->count, sizeof *fracturer->list, dgfemi_overload_compare);
}

static void dgfemi_fracture_break_faces(dgfemi_fracturer *fracturer) {
    for (int i = 0; i < fracturer->count && fracturer->info->faces_broken < fracturer->desc->max_breaks; i++) {
        dgfem_face *face = &fracturer->edit->mesh->faces[fracturer->list[i].item];
        face->cut = 1;
        fracturer->touched[face->element[0]] = fracturer->touched[face->element[1]] = 1;
        fracturer->info->faces_broken++;
    }
}

/* ---- elements ---- */

static dgfem_real dgfemi_element_width(const dgfem_mesh *mesh, int element, dgfem_vec3 direction) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real low = 0, high = 0;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (int i = 0; i < mesh->loops[l].count; i++) {
                dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
                dgfem_real d = dgfemi_dot(direction, dgfemi_sub(p, e->centre));
                low = dgfemi_min(low, d), high = dgfemi_max(high, d);
            }
    }
    return high - low;
}

static void dgfemi_fracture_list_elements(dgfemi_fracturer *fracturer) {
    const dgfem_body *body = fracturer->body;
    const dgfem_fracture_desc *desc = fracturer->desc;
    dgfem_real smallest = desc->smallest * desc->smallest * desc->smallest, values[3];
    dgfem_mat3 directions;
    fracturer->count = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        if (fracturer->touched[e] || body->mesh->elements[e].volume < 2 * smallest) continue;
        dgfemi_refine_principal(body, e, values, &directions);
        dgfem_real ratio = values[2] / dgfemi_fracture_strength(desc, e);
        if (!(ratio >= 1)) continue;
        dgfem_real width = dgfemi_element_width(body->mesh, e, dgfemi_column(&directions, 2));
        if (!(values[2] * values[2] / (2 * body->material[e].young) * width >= desc->toughness)) continue;
        fracturer->list[fracturer->count].ratio = ratio;
        fracturer->list[fracturer->count++].item = e;
    }
    qsort(fracturer->list, (size_t)fracturer->count, sizeof *fracturer->list, dgfemi_overload_compare);
}

/* Breaks the faces between parts of the element that lie in the plane of its split, and counts them. */
static int dgfemi_fracture_break_caps(const dgfemi_splitter *s, int element) {
    int count = 0;
    for (int c = 0; c < s->child_count; c++) {
        const dgfemi_split_child *child = &s->children[c];
        if (child->parent != element || child->side >= 0) continue; /* the parts above have the same caps */
        for (int f = child->cap_start; f < child->cap_end; f++)
            if (!s->mesh->faces[f].cut) s->mesh->faces[f].cut = 1, count++;
    }
    return count;
}

static dgfem_status dgfemi_fracture_split_elements(dgfemi_fracturer *fracturer) {
    dgfemi_refiner refiner;
    dgfem_status status = DGFEM_OK;
    dgfemi_refiner_make(&refiner, fracturer->edit);
    for (int i = 0; !status && i < fracturer->count; i++) {
        int e = fracturer->list[i].item;
        dgfem_mat3 directions;
        dgfem_real values[3];
        if (fracturer->info->faces_broken >= fracturer->desc->max_breaks) break;
        dgfemi_refine_principal(fracturer->body, e, values, &directions);
        dgfem_vec3 normal = dgfemi_normalized(dgfemi_column(&directions, 2));
        dgfem_plane plane = dgfemi_refine_plane(fracturer->edit->mesh, e, normal);
        refiner.parts.count = 0;
        if (!dgfemi_push(&fracturer->body->hooks, &refiner.parts, e))
            status = dgfemi_fail_memory(&fracturer->body->hooks);
        if (!status) status = dgfemi_refiner_split(&refiner, plane);
        if (status || refiner.parts.count == 1) continue;
        fracturer->info->elements_split++;
        fracturer->info->faces_broken += dgfemi_fracture_break_caps(&refiner.splitter, e);
    }
    dgfemi_refiner_free(&refiner);
    return status;
}

/* ---- the call ---- */

DGFEM_API dgfem_fracture_desc dgfem_default_fracture_desc(void) {
    dgfem_fracture_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.strength = DGFEM_R(HUGE_VAL);
    desc.sliver = DGFEM_R(1e-3);
    desc.max_breaks = INT_MAX;
    return desc;
}

static dgfem_status dgfemi_check_strengths(const dgfem_body *body, const dgfem_fracture_desc *desc) {
    if (!desc->strengths && !(desc->strength > 0))
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "fracture: strength is %g, expected > 0",
                           (double)desc->strength);
    for (int e = 0; desc->strengths && e < body->mesh->element_count; e++)
        if (!(desc->strengths[e] > 0))
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT,
                               "fracture: strength of element %d is %g, expected > 0", e, (double)desc->strengths[e]);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_fracture(const dgfem_body *body, const dgfem_fracture_desc *desc) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_status status = dgfemi_check_desc(hooks, desc, desc ? desc->cookie : 0, "fracture");
    if (!status) status = dgfemi_check_strengths(body, desc);
    if (!status) status = dgfemi_check_not_negative(hooks, desc->toughness, "fracture: toughness");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->smallest, "fracture: smallest");
    if (!status && !(desc->sliver >= 0 && desc->sliver < 1))
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "fracture: sliver is %g, expected in [0, 1)",
                             (double)desc->sliver);
    if (!status && desc->max_breaks < 0)
        status =
            dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "fracture: max_breaks is %d, expected >= 0", desc->max_breaks);
    return status;
}

/* Lists, breaks, splits, in the edit. */
static dgfem_status dgfemi_fracture(dgfemi_edit *edit, const dgfem_fracture_desc *desc, dgfem_fracture_info *info) {
    const dgfem_body *body = edit->body;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    size_t elements = (size_t)body->mesh->element_count, faces = (size_t)body->mesh->face_count;
    dgfem_status status = DGFEM_OK;
    dgfemi_fracturer fracturer;
    fracturer.body = body, fracturer.desc = desc, fracturer.edit = edit, fracturer.info = info;
    fracturer.list =
        (dgfemi_overload *)dgfemi_arena_allocate(&arena, faces > elements ? faces : elements, sizeof *fracturer.list);
    fracturer.touched = (char *)dgfemi_arena_allocate_zero(&arena, elements, 1);
    if (fracturer.list && fracturer.touched) {
        dgfemi_fracture_list_faces(&fracturer);
        dgfemi_fracture_break_faces(&fracturer);
        if (desc->split) {
            dgfemi_fracture_list_elements(&fracturer);
            status = dgfemi_fracture_split_elements(&fracturer);
        }
    } else status = dgfemi_fail_memory(&body->hooks);
    dgfemi_arena_free(&arena);
    if (!status && desc->sliver > 0 && info->elements_split > 0)
        status = dgfemi_edit_merge(edit, desc->sliver, 0, 0, &info->slivers_merged);
    return status;
}

DGFEM_API dgfem_status dgfem_body_fracture(dgfem_body *body, const dgfem_fracture_desc *desc,
                                           dgfem_fracture_info *info) {
    dgfem_fracture_info done;
    dgfemi_edit edit;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_fracture(body, desc);
    if (!status) status = dgfemi_edit_begin(&edit, body);
    if (status) return status;
    memset(&done, 0, sizeof done);
    status = dgfemi_fracture(&edit, desc, &done);
    if (!status && done.faces_broken > 0) status = dgfemi_edit_finish(&edit, body);
    dgfemi_edit_free(&edit);
    if (!status && info) *info = done;
    return status;
}
