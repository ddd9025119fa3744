/* A soft bunny of tetrahedra falls, and is sliced on the way: blades in upright planes go through it step by step,
   several at a time, and press what they part a little aside. The slices land and are cut again, crosswise, wherever
   they are then (Wicke, Botsch, Gross 2007, figure 10). Prints one number a line; --ply FILE writes the picture: the
   bunny with the blades half through, the slices on the ground, and what is left of them; walls of cuts in their own
   colour.

   Tetrahedra come from a file of TetGen or Gmsh (mvc_bunny mesh.ele), or a lattice is fitted to --model, or to a shape
   made here. y is up in files (--up z: z is). */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"

#include "convex_mesh.h"
#include "lattice.h"
#include "model.h"
#include "picture.h"
#include "program.h"

typedef struct slicing {
    double young, dt, height, thick, apart; /* Pa, s, m, m, 1/s */
    int cells, slices, stages, layers, steps, up;
    const char *mesh, *model, *ply;
} slicing;

typedef struct counts {
    int cuts, split, kept, slivers, left, pieces, steps;
    double cut_seconds, worst_cut, step_seconds, volume;
} counts;

static slicing read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "mvc_bunny [mesh.ele|mesh.msh] [--up y|z] [--model FILE] [--cells 11] [--slices 12]\n"
                              "  [--stages 5] [--layers 2] [--young 200000] [--height 0.75] [--apart 0.9]\n"
                              "  [--dt 0.005] [--steps 200] [--ply FILE]");
    slicing o;
    o.cells = program_int(&p, "--cells", 11, 2, 100);
    o.slices = program_int(&p, "--slices", 12, 0, 200);
    o.stages = program_int(&p, "--stages", 5, 1, 50);
    o.layers = program_int(&p, "--layers", 2, 0, 50);
    o.young = program_real(&p, "--young", 200000);
    o.height = program_real(&p, "--height", 0.75);
    o.apart = program_real(&p, "--apart", 0.9);
    o.dt = program_real(&p, "--dt", 0.005);
    o.steps = program_int(&p, "--steps", 200, 1, 1000000);
    o.up = program_choice(&p, "--up", "y|z", 0);
    o.model = program_text(&p, "--model", NULL);
    o.ply = program_text(&p, "--ply", NULL);
    o.mesh = program_argument(&p);
    program_end(&p);
    return o;
}

/* ---- the bunny ---- */

/* From y up to z up, one metre tall, `height` above the origin. */
static void stand_up(const slicing *o, formats_tetrahedra *t) {
    double lower[3] = {INFINITY, INFINITY, INFINITY}, upper[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int v = 0; v < t->vertex_count; v++) {
        double *x = t->vertices + 3 * v, y = x[1];
        if (o->up == 0) x[1] = -x[2], x[2] = y;
        for (int k = 0; k < 3; k++) lower[k] = fmin(lower[k], x[k]), upper[k] = fmax(upper[k], x[k]);
    }
    for (int i = 0; i < 3 * t->vertex_count; i++) {
        double origin = i % 3 == 2 ? lower[2] : (lower[i % 3] + upper[i % 3]) / 2;
        t->vertices[i] = (t->vertices[i] - origin) / (upper[2] - lower[2]) + (i % 3 == 2 ? o->height : 0);
    }
}

static int read_mesh(slicing *o, formats_tetrahedra *out) {
    formats_error error;
    formats_surface surface;
    if (o->mesh) {
        if (formats_read_tetrahedra(o->mesh, out, &error)) return 1;
        return fprintf(stderr, "%s\n", error.text), 0;
    }
    o->up = 1; /* models stand already */
    if (!model_read(o->model, &surface)) return 0;
    int ok = lattice_fill(&surface, o->cells, out);
    formats_free_surface(&surface);
    if (!ok) fprintf(stderr, "no tetrahedra inside the model, or out of memory\n");
    return ok;
}

static dgfem_mvc *create(slicing *o) {
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_shape_desc ground = dgfem_default_shape_desc();
    dgfem_hooks hooks = program_hooks();
    formats_tetrahedra tetrahedra;
    dgfem_mesh *mesh;
    dgfem_mvc *body = NULL;
    if (!read_mesh(o, &tetrahedra)) return NULL;
    stand_up(o, &tetrahedra);
    dgfem_status status = formats_tetrahedra_mesh(&tetrahedra, &hooks, &mesh);
    formats_free_tetrahedra(&tetrahedra);
    if (status) return NULL;
    desc.mesh = mesh;
    desc.material.young = (dgfem_real)o->young;
    desc.damping_stiffness = (dgfem_real)0.003;
    desc.stabilisation = (dgfem_real)0.1;
    desc.hooks = hooks;
    ground.friction = (dgfem_real)0.6;
    status = dgfem_mvc_create(&desc, &body);
    dgfem_mesh_destroy(mesh);
    if (!status) status = dgfem_mvc_add_plane(body, &ground, NULL);
    if (!status) return body;
    dgfem_mvc_destroy(body);
    return NULL;
}

static void bounds(const dgfem_mvc *body, double lower[3], double upper[3]) {
    for (int k = 0; k < 3; k++) lower[k] = INFINITY, upper[k] = -INFINITY;
    for (int i = 0; i < body->node_count; i++) {
        double x[3] = {(double)body->position[i].x, (double)body->position[i].y, (double)body->position[i].z};
        for (int k = 0; k < 3; k++) lower[k] = fmin(lower[k], x[k]), upper[k] = fmax(upper[k], x[k]);
    }
}

/* ---- cuts ---- */

/* Told of each new piece. */
static void count_piece(void *user, const dgfem_mvc *body, int piece, const int *elements, int count) {
    (void)body, (void)piece, (void)elements, (void)count;
    ++*(int *)user;
}

/* The blades press pieces aside: each but the largest, in which other blades may still be, gets a speed along x that
   grows with the distance of its centre from the middle. */
static dgfem_status press_aside(dgfem_mvc *body, double apart) {
    int count, largest = 0, *piece_of = (int *)malloc((size_t)body->element_count * sizeof(int)), nodes[1024];
    dgfem_piece *pieces = NULL;
    dgfem_vec3 *velocity = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *velocity);
    dgfem_status status = piece_of && velocity ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_mvc_pieces(body, piece_of, NULL, 0, &count);
    if (!status) pieces = (dgfem_piece *)malloc((size_t)count * sizeof *pieces);
    if (!status && !pieces) status = DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_mvc_pieces(body, piece_of, pieces, count, &count);
    if (!status) memcpy(velocity, body->velocity, (size_t)body->node_count * sizeof *velocity);
    for (int k = 1; !status && k < count; k++)
        if (pieces[k].volume > pieces[largest].volume) largest = k;
    for (int e = 0; !status && e < body->element_count; e++) {
        const dgfem_piece *p = &pieces[piece_of[e]];
        if (piece_of[e] == largest) continue;
        int found = dgfem_mvc_element_nodes(body, e, nodes, 1024);
        double speed = apart * (double)p->centre.x, now = (double)p->momentum.x / (double)p->mass;
        for (int k = 0; k < found && k < 1024; k++)
            velocity[nodes[k]].x = body->velocity[nodes[k]].x + (dgfem_real)(speed - now);
    }
    if (!status) status = dgfem_mvc_set_velocities(body, dgfem_points_in_vec3(velocity, body->node_count));
    free(pieces);
    free(piece_of);
    free(velocity);
    return status;
}

static void count_cut(counts *n, const dgfem_mvc_cut_info *info, double seconds) {
    n->cuts++;
    n->split += info->elements_split, n->kept += info->elements_kept;
    n->slivers += info->slivers_removed, n->left = info->slivers_left;
    n->pieces = info->pieces;
    n->cut_seconds += seconds, n->worst_cut = fmax(n->worst_cut, seconds);
}

/* The upright plane at x, from the far side (y) up to where the blade's edge is: a part t of its way. */
static dgfem_status slice(dgfem_mvc *body, double x, double t, const dgfem_mvc_cut_desc *desc, counts *n) {
    double lower[3], upper[3], start = program_seconds();
    dgfem_mvc_cut_info info;
    dgfem_vec3 corners[4];
    bounds(body, lower, upper);
    double near = lower[1] - 0.1, far = near + t * (upper[1] - lower[1] + 0.2);
    for (int k = 0; k < 4; k++)
        corners[k] = convex_mesh_vec3(x, k == 1 || k == 2 ? far : near, k < 2 ? lower[2] - 0.1 : upper[2] + 0.1);
    dgfem_status status = dgfem_mvc_cut_polygon(body, dgfem_points_in_vec3(corners, 4), desc, &info);
    count_cut(n, &info, program_seconds() - start);
    return status;
}

/* ---- the scene ---- */

typedef struct scene {
    const slicing *o;
    dgfem_mvc *body;
    picture drawing;
    counts n;
    double left, pitch; /* of the slices */
} scene;

/* The body as it is now, moved along x. */
static int draw(scene *s, double x) {
    dgfem_mvc_surface *surface;
    if (dgfem_mvc_surface_create(s->body, &surface)) return 0;
    int *wall = (int *)malloc((size_t)surface->triangle_count * sizeof(int));
    if (!wall) return dgfem_mvc_surface_destroy(surface), 0;
    for (int i = 0; i < surface->vertex_count; i++) surface->positions[i].x += (dgfem_real)x;
    for (int t = 0; t < surface->triangle_count; t++) wall[t] = dgfem_mvc_face_is_wall(s->body, surface->face[t]);
    picture_add_mesh(&s->drawing, surface->positions, surface->normals, surface->vertex_count, surface->triangles, wall,
                     surface->triangle_count, picture_rgb(90, 160, 255), picture_rgb(255, 150, 90));
    free(wall);
    dgfem_mvc_surface_destroy(surface);
    return 1;
}

/* The blades of one step: one more begins each second step, and each goes on until it is through. */
static dgfem_status move_blades(scene *s, int step) {
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    dgfem_status status = DGFEM_OK;
    int parted = 0;
    desc.new_piece = count_piece;
    desc.new_piece_user = &parted;
    for (int k = 0; !status && k < s->o->slices; k++) {
        int stage = step - 2 * k;
        /* from both ends to the middle: what is parted moves away from what is not */
        int place = k % 2 ? s->o->slices - 1 - k / 2 : k / 2;
        if (stage < 1 || stage > s->o->stages) continue;
        status = slice(s->body, s->left + (place + 1) * s->pitch, (double)stage / s->o->stages, &desc, &s->n);
    }
    return !status && parted ? press_aside(s->body, s->o->apart) : status;
}

/* Cuts everything at some heights, askew. */
static dgfem_status cut_layers(scene *s) {
    double lower[3], upper[3];
    dgfem_status status = DGFEM_OK;
    bounds(s->body, lower, upper);
    for (int k = 0; !status && k < s->o->layers; k++) {
        double z = lower[2] + (k + 1.0) / (s->o->layers + 1) * (upper[2] - lower[2]), start = program_seconds();
        dgfem_mvc_cut_info info;
        status = dgfem_mvc_cut_plane(s->body, convex_mesh_plane(0.1 * (k % 2 ? 1 : -1), 0.25, 1, z), NULL, &info);
        count_cut(&s->n, &info, program_seconds() - start);
    }
    return status;
}

static dgfem_status run(scene *s) {
    const slicing *o = s->o;
    int blades_end = 2 * (o->slices - 1) + o->stages, half = o->slices + o->stages / 2;
    int landed = (int)(1.35 * sqrt(2 * o->height / 9.81) / o->dt);
    dgfem_status status = DGFEM_OK;
    for (int step = 1; !status && step <= o->steps; step++) {
        double start = program_seconds();
        status = dgfem_mvc_step(s->body, (dgfem_real)o->dt, NULL);
        s->n.step_seconds += program_seconds() - start;
        s->n.steps++;
        if (!status && step <= blades_end) status = move_blades(s, step);
        if (!status && step == landed) status = cut_layers(s);
        if (!status && step == half && !draw(s, 0)) status = DGFEM_ERROR_MEMORY;
        if (!status && step == landed && !draw(s, 1.7)) status = DGFEM_ERROR_MEMORY;
    }
    if (!status && !draw(s, 3.9)) status = DGFEM_ERROR_MEMORY;
    return status ? status : dgfem_mvc_check(s->body);
}

static void report(const scene *s, double volume) {
    const dgfem_mvc *body = s->body;
    int most = 0, tetrahedra = 0;
    for (int e = 0; e < body->element_count; e++) {
        int nodes = dgfem_mvc_element_nodes(body, e, NULL, 0);
        if (nodes > most) most = nodes;
        tetrahedra += nodes == 4;
    }
    printf("nodes %d\nelements %d\ntetrahedra_left_percent %.1f\nmost_nodes_of_element %d\n", body->node_count,
           body->element_count, 100.0 * tetrahedra / body->element_count, most);
    printf("pieces %d\ncuts %d\nelements_split %d\nelements_kept %d\n", s->n.pieces, s->n.cuts, s->n.split, s->n.kept);
    printf("slivers_removed %d\nslivers_left %d\n", s->n.slivers, s->n.left);
    printf("volume_error %.2e\n", fabs((double)dgfem_mvc_rest_volume(body) / volume - 1));
    printf("milliseconds_per_cut %.2f\nmilliseconds_worst_cut %.2f\nmilliseconds_per_step %.2f\n",
           1e3 * s->n.cut_seconds / (s->n.cuts ? s->n.cuts : 1), 1e3 * s->n.worst_cut,
           1e3 * s->n.step_seconds / s->n.steps);
}

int main(int argc, char **argv) {
    slicing o = read_options(argc, argv);
    scene s;
    double lower[3], upper[3];
    memset(&s, 0, sizeof s);
    s.o = &o;
    s.body = create(&o);
    if (!s.body) return 1;
    double volume = (double)dgfem_mvc_rest_volume(s.body);
    bounds(s.body, lower, upper);
    s.left = lower[0];
    s.pitch = (upper[0] - lower[0]) / (o.slices + 1);
    printf("start_nodes %d\nstart_elements %d\n", s.body->node_count, s.body->element_count);
    dgfem_status status = run(&s);
    if (status) return fprintf(stderr, "%s\n", dgfem_status_text(status)), 1;
    report(&s, volume);
    picture_add_parallelogram(&s.drawing, convex_mesh_vec3(-1, -1.4, 0), convex_mesh_vec3(6.8, 0, 0),
                              convex_mesh_vec3(0, 2.8, 0), picture_rgb(245, 245, 240));
    int written = !o.ply || picture_write(&s.drawing, o.ply);
    if (!o.ply) picture_free(&s.drawing);
    dgfem_mvc_destroy(s.body);
    return !written;
}
