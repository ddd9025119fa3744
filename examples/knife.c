/* A knife goes through a soft bunny again and again, while it falls and lies on the floor. In each time step the area that
   the edge has swept is cut, and the skin with it.

   Writes into the folder --out: skin_NNNN.obj and elements_NNNN.vtu for every frame, and middle.ply and end.ply (floor and
   skin, with the walls of the cuts in another colour). */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include <sys/stat.h>

#include "formats.h"
#include "model.h"
#include "picture.h"
#include "program.h"

typedef struct options {
    const char *model, *out;
    int cells, cuts, seed, frame_every, write_frames, use_skin, check;
    double seconds, dt, young, first, smallest, stroke;
} options;

/* One stroke: the edge, from `middle` half its length to both sides, travels down `travel` in the time of a stroke. */
typedef struct knife {
    dgfem_vec3 middle, along, travel;
    int is_down;
    double start;
} knife;

typedef struct scene {
    formats_surface surface;
    dgfem_body *body;
    dgfem_skin *skin;
    knife knife;
    unsigned long long random;
} scene;

/* What the run has measured. */
typedef struct statistics {
    double *ordinary, *cutting; /* milliseconds of each step */
    int ordinary_count, cutting_count, strokes, faces_cut, split, frames;
    double volume;
} statistics;

static options read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "knife [--model FILE] [--out build/knife] [--cells 11] [--cuts 5] [--seconds 2.5]\n"
                              "  [--dt 0.0166667] [--first 0.25] [--stroke 0.2] [--smallest 0.01] [--seed 1]\n"
                              "  [--young 1e5] [--frame-every 3] [--no-frames] [--surface] [--check]");
    options o;
    o.model = program_text(&p, "--model", NULL);
    o.out = program_text(&p, "--out", "build/knife");
    o.cells = program_int(&p, "--cells", 11, 1, 1000);
    o.cuts = program_int(&p, "--cuts", 5, 0, 1000000);
    o.seconds = program_real(&p, "--seconds", 2.5);
    o.dt = program_real(&p, "--dt", 1.0 / 60);
    o.first = program_real(&p, "--first", 0.25);  /* when the first stroke begins */
    o.stroke = program_real(&p, "--stroke", 0.2); /* how long one takes at most */
    o.smallest = program_real(&p, "--smallest", 0.01);
    o.seed = program_int(&p, "--seed", 1, 0, INT_MAX);
    o.young = program_real(&p, "--young", 1e5);
    o.frame_every = program_int(&p, "--frame-every", 3, 1, 1000000);
    o.write_frames = !program_flag(&p, "--no-frames");
    o.use_skin = !program_flag(&p, "--surface"); /* the boundary of the elements is shown instead */
    o.check = program_flag(&p, "--check");
    program_end(&p);
    return o;
}

static dgfem_vec3 add_scaled(dgfem_vec3 a, double s, dgfem_vec3 b) {
    a.x += (dgfem_real)s * b.x, a.y += (dgfem_real)s * b.y, a.z += (dgfem_real)s * b.z;
    return a;
}

static dgfem_vec3 vector(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

/* ---- the scene ---- */

static dgfem_status make_body(const options *o, scene *s) {
    dgfem_slice_desc slice = dgfem_default_slice_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    slice.vertices = dgfem_points_in_double(s->surface.vertices, s->surface.vertex_count);
    slice.triangles = s->surface.triangles;
    slice.triangle_count = s->surface.triangle_count;
    slice.cells = o->cells;
    slice.hooks = desc.hooks = program_hooks();
    dgfem_status status = dgfem_mesh_create_slices(&slice, &desc.mesh);
    if (status) return status;
    desc.material.young = (dgfem_real)o->young;
    desc.material.poisson = DGFEM_R(0.4);
    desc.eta_rest = DGFEM_R(0.7);
    desc.damping_stiffness = DGFEM_R(0.01);
    desc.damping_mass = DGFEM_R(0.5);
    status = dgfem_body_create(&desc, &s->body);
    if (status) dgfem_mesh_destroy(desc.mesh);
    return status;
}

static dgfem_status make_skin(scene *s) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    desc.vertices = dgfem_points_in_double(s->surface.vertices, s->surface.vertex_count);
    desc.triangles = s->surface.triangles;
    desc.triangle_count = s->surface.triangle_count;
    desc.hooks = program_hooks();
    return dgfem_skin_create(s->body, &desc, &s->skin);
}

static dgfem_status update_skin(scene *s) { return s->skin ? dgfem_skin_update(s->skin, s->body) : DGFEM_OK; }

/* The bunny begins a little above the floor z = 0. */
static int make_scene(const options *o, scene *s) {
    dgfem_shape_desc floor = dgfem_default_shape_desc();
    dgfem_mat3 none = {{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}};
    memset(s, 0, sizeof *s);
    s->random = (unsigned long long)o->seed;
    floor.plane.normal.z = 1;
    floor.friction = DGFEM_R(0.6);
    return model_read(o->model, &s->surface) && !make_body(o, s) && (!o->use_skin || !make_skin(s)) &&
           !dgfem_body_add_plane(s->body, &floor, NULL) && !dgfem_body_set_affine(s->body, none, vector(0, 0, 0.3)) &&
           !update_skin(s);
}

static void destroy_scene(scene *s) {
    dgfem_skin_destroy(s->skin);
    dgfem_body_destroy(s->body);
    formats_free_surface(&s->surface);
}

/* ---- the knife ---- */

/* In [0, 1). */
static double random_number(scene *s) {
    unsigned long long z = s->random += 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

/* The first stroke comes down through the back, the second one across it, later ones through an element anywhere; two in
   three are wide, and end below the body or within. */
static void begin_stroke(const options *o, scene *s, int stroke) {
    const double turn = 6.28318530717958648;
    int e = (int)(random_number(s) * s->body->mesh->element_count);
    double around = turn * random_number(s), lean = 0.7 * (random_number(s) - 0.5);
    double half = random_number(s) < 0.67 ? 2 : 0.1 + 0.3 * random_number(s), beyond = 0.6 * random_number(s);
    dgfem_vec3 rest = s->body->mesh->elements[e].centre, target;
    if (stroke < 2) rest = vector(0, 0, 0.4), around = stroke * turn / 4 + 0.3, lean = 0.1, half = 2, beyond = 0.6;
    target = add_scaled(rest, 1, dgfem_body_displacement(s->body, e, rest));
    if (stroke < 2) target = vector(-0.05, 0, 0.4);
    dgfem_vec3 down = vector(-sin(around) * sin(lean), cos(around) * sin(lean), -cos(lean));
    s->knife.along = vector(half * cos(around), half * sin(around), 0);
    s->knife.middle = add_scaled(target, -1, down);
    s->knife.travel = vector(0, 0, 0);
    s->knife.travel = add_scaled(s->knife.travel, 1 + beyond, down);
    s->knife.start = o->first + stroke * (o->seconds - o->first) / (o->cuts > 0 ? o->cuts : 1);
    s->knife.is_down = 1;
}

/* Cuts the quad from where the edge was, `before`, to where it is, `now` (0..1 of its way). The material beside the edge
   has moved since: with it goes the old edge, as far as the body's mean velocity tells; a little is cut twice.

        0 ------------ 1    edge before
        |           /  |
        |     /        |
        2 ------------ 3    edge now            */
static dgfem_status cut(const options *o, scene *s, double before, double now, dgfem_cut_info *info) {
    static const int triangles[] = {0, 2, 1, 1, 2, 3};
    dgfem_vec3 corners[4], momentum;
    dgfem_cut_desc desc = dgfem_default_cut_desc();
    dgfem_status status = dgfem_body_momentum(s->body, &momentum, NULL);
    if (status) return status;
    before -= 0.2 * (now - before);
    for (int k = 0; k < 4; k++) {
        corners[k] = add_scaled(s->knife.middle, k < 2 ? before : now, s->knife.travel);
        corners[k] = add_scaled(corners[k], k % 2 ? 1 : -1, s->knife.along);
        if (k < 2) corners[k] = add_scaled(corners[k], o->dt / (double)dgfem_body_mass(s->body), momentum);
    }
    desc.smallest = (dgfem_real)o->smallest;
    desc.skins = &s->skin;
    desc.skin_count = o->use_skin;
    return dgfem_body_cut_surface(s->body, dgfem_points_in_vec3(corners, 4), triangles, 2, &desc, info);
}

/* Moves the knife to the time `now`; *cuts tells whether it is in a stroke. */
static dgfem_status move_knife(const options *o, scene *s, double now, dgfem_cut_info *info, statistics *st) {
    double period = o->cuts > 0 ? (o->seconds - o->first) / o->cuts : o->seconds, length = fmin(o->stroke, period);
    memset(info, 0, sizeof *info);
    if (!s->knife.is_down && st->strokes < o->cuts && now > o->first + st->strokes * period + 1e-9)
        begin_stroke(o, s, st->strokes++);
    if (!s->knife.is_down) return DGFEM_OK;
    double before = fmax(0, (now - o->dt - s->knife.start) / length), after = (now - s->knife.start) / length;
    s->knife.is_down = after < 1 - 1e-9;
    return cut(o, s, before, fmin(after, 1), info);
}

/* ---- output ---- */

static dgfem_vec3 deformed(void *user, int element, int vertex) {
    const dgfem_body *body = (const dgfem_body *)user;
    dgfem_vec3 x = body->mesh->vertices[vertex];
    return add_scaled(x, 1, dgfem_body_displacement(body, element, x));
}

/* What is to be seen: the skin, or else the boundary of the elements. */
static dgfem_status make_boundary(const scene *s, dgfem_surface **out) {
    *out = NULL;
    dgfem_status status = s->skin ? DGFEM_OK : dgfem_surface_create(s->body, out);
    return *out ? dgfem_surface_update(*out, s->body) : status;
}

static int write_frame(const options *o, const scene *s, int frame) {
    char path[1024];
    formats_error error;
    dgfem_surface *b;
    const dgfem_skin *skin = s->skin;
    if (make_boundary(s, &b)) return 0;
    int vertices = skin ? skin->vertex_count : b->vertex_count;
    snprintf(path, sizeof path, "%s/skin_%04d.obj", o->out, frame);
    int ok = formats_write_obj(path, dgfem_points_in_vec3(skin ? skin->positions : b->positions, vertices),
                               dgfem_points_in_vec3(skin ? skin->normals : b->normals, vertices),
                               skin ? skin->triangles : b->triangles, skin ? skin->triangle_count : b->triangle_count,
                               &error);
    dgfem_surface_destroy(b);
    snprintf(path, sizeof path, "%s/elements_%04d.vtu", o->out, frame);
    if (ok) ok = formats_write_vtu(path, s->body->mesh, deformed, s->body, NULL, 0, &error);
    if (!ok) fprintf(stderr, "%s\n", error.text);
    return ok;
}

static int write_picture(const options *o, const scene *s, const char *name) {
    const picture_color outside = picture_rgb(90, 150, 225), inside = picture_rgb(235, 120, 90);
    char path[1024];
    picture p;
    dgfem_surface *boundary;
    memset(&p, 0, sizeof p);
    if (make_boundary(s, &boundary)) return 0;
    picture_add_parallelogram(&p, vector(-1.6, -1.6, 0), vector(3.2, 0, 0), vector(0, 3.2, 0),
                              picture_rgb(200, 205, 210));
    if (boundary) picture_add_surface(&p, boundary, outside, inside);
    else picture_add_skin(&p, s->skin, outside, inside);
    dgfem_surface_destroy(boundary);
    snprintf(path, sizeof path, "%s/%s.ply", o->out, name);
    return picture_write(&p, path);
}

/* Every number finite, the mesh whole, no volume lost. */
static int is_sound(const scene *s, double volume) {
    const char *wrong = NULL;
    for (int v = 0; s->skin && v < s->skin->vertex_count; v++) {
        dgfem_vec3 x = s->skin->positions[v], n = s->skin->normals[v];
        if (!isfinite((double)(x.x + x.y + x.z + n.x + n.y + n.z))) wrong = "a number of the skin is not finite";
        if (!(fabs((double)x.x) + fabs((double)x.y) + fabs((double)x.z) < 100))
            wrong = "a vertex of the skin is far away";
    }
    if (dgfem_mesh_check(s->body->mesh)) wrong = "the mesh is broken";
    if (!(fabs((double)dgfem_mesh_volume(s->body->mesh) / volume - 1) < (DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-9)))
        wrong = "volume is lost";
    if (wrong) fprintf(stderr, "knife: at %.4f s %s\n", s->body->time, wrong);
    return !wrong;
}

/* ---- the run ---- */

static int step(const options *o, scene *s, int i, statistics *st) {
    dgfem_cut_info info;
    double start = program_seconds();
    dgfem_status status = move_knife(o, s, i * o->dt, &info, st);
    if (!status) status = dgfem_body_step(s->body, (dgfem_real)o->dt, NULL);
    if (!status) status = update_skin(s);
    double milliseconds = 1e3 * (program_seconds() - start);
    if (status) return fprintf(stderr, "knife: at %.4f s: %s\n", s->body->time, dgfem_status_text(status)), 0;
    st->faces_cut += info.faces_cut, st->split += info.elements_split;
    if (info.faces_cut > 0) st->cutting[st->cutting_count++] = milliseconds;
    else st->ordinary[st->ordinary_count++] = milliseconds;
    return !o->check || is_sound(s, st->volume);
}

static int run(const options *o, scene *s, statistics *st) {
    int steps = (int)(o->seconds / o->dt + 0.5), ok;
    program_progress progress;
    memset(&progress, 0, sizeof progress);
    memset(st, 0, sizeof *st);
    st->ordinary = (double *)malloc((size_t)(steps + 1) * sizeof(double));
    st->cutting = (double *)malloc((size_t)(steps + 1) * sizeof(double));
    st->volume = (double)dgfem_mesh_volume(s->body->mesh);
    ok = st->ordinary && st->cutting;
    for (int i = 0; ok && i <= steps; i++) {
        if (i > 0) ok = step(o, s, i, st);
        if (ok && o->write_frames && i % o->frame_every == 0) ok = write_frame(o, s, st->frames++);
        if (ok && o->write_frames && i == steps / 2) ok = write_picture(o, s, "middle");
        program_show_progress(&progress, i, steps, "knife");
    }
    program_end_progress(&progress);
    return ok && (!o->write_frames || write_picture(o, s, "end"));
}

static int compare_numbers(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void print_times(const char *name, double *milliseconds, int count) {
    if (!count) return;
    qsort(milliseconds, (size_t)count, sizeof *milliseconds, compare_numbers);
    printf("%s %d, median %.2f ms, longest %.2f ms\n", name, count, milliseconds[count / 2], milliseconds[count - 1]);
}

static int print_summary(const scene *s, const statistics *st) {
    int pieces;
    if (dgfem_body_pieces(s->body, NULL, NULL, 0, &pieces)) return 0;
    printf("strokes            %d; %d faces cut, %d elements split\n", st->strokes, st->faces_cut, st->split);
    printf("elements           %d in %d pieces\n", s->body->mesh->element_count, pieces);
    if (s->skin)
        printf("skin               %d vertices, %d at first; %d triangles, %d at first\n", s->skin->vertex_count,
               s->surface.vertex_count, s->skin->triangle_count, s->surface.triangle_count);
    printf("volume             changed by %.2g\n", (double)dgfem_mesh_volume(s->body->mesh) / st->volume - 1);
    print_times("ordinary steps    ", st->ordinary, st->ordinary_count);
    print_times("steps that cut    ", st->cutting, st->cutting_count);
    return 1;
}

int main(int argc, char **argv) {
    options o = read_options(argc, argv);
    scene s;
    statistics st;
    memset(&st, 0, sizeof st);
    (void)mkdir(o.out, 0777); /* where it cannot be made, writing the first frame says so */
    int ok = make_scene(&o, &s) && run(&o, &s, &st) && print_summary(&s, &st);
    free(st.ordinary);
    free(st.cutting);
    destroy_scene(&s);
    return ok ? 0 : 1;
}
