/* A pencil, one convex element, is turned in a sharpener: a plane that stands still in the world cuts it again and again,
   and the shavings fall off. Springs hold and turn the pencil; each shaving is an element of its own.

   Writes the picture --ply and the elements --vtu. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "picture.h"
#include "program.h"

enum { SIDES = 6, PINS = 4 };

static const double turn = 6.28318530717958648;

typedef struct pencil {
    int cuts, rounds, steps; /* planes; turns of the pencil in which they are made; time steps from one to the next */
    double length, radius, lead; /* m; distance of edges from the axis; radius of the lead, for the picture */
    double angle, dt;            /* of the point, degrees; s */
    const char *ply, *vtu;
    dgfem_vec3 places[PINS]; /* at rest */
    int pins[PINS];
} pencil;

static pencil read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "pencil [--cuts 72] [--rounds 3] [--steps 8] [--length 0.175] [--radius 0.004]\n"
                              "  [--lead 0.0011] [--angle 24] [--dt 0.002] [--ply FILE] [--vtu FILE]");
    pencil o;
    memset(&o, 0, sizeof o);
    o.cuts = program_int(&p, "--cuts", 72, 1, 10000);
    o.rounds = program_int(&p, "--rounds", 3, 1, 1000);
    o.steps = program_int(&p, "--steps", 8, 1, 1000);
    o.length = program_real(&p, "--length", 0.175);
    o.radius = program_real(&p, "--radius", 0.004);
    o.lead = program_real(&p, "--lead", 0.0011);
    o.angle = program_real(&p, "--angle", 24);
    o.dt = program_real(&p, "--dt", 0.002);
    o.ply = program_text(&p, "--ply", NULL);
    o.vtu = program_text(&p, "--vtu", NULL);
    program_end(&p);
    return o;
}

static dgfem_vec3 vector(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

/* Turned about the x axis. */
static dgfem_vec3 turned(dgfem_vec3 x, double angle) {
    double c = cos(angle), s = sin(angle);
    return vector((double)x.x, c * (double)x.y - s * (double)x.z, s * (double)x.y + c * (double)x.z);
}

/* ---- the pencil ---- */

/* A prism along x: two hexagons and six sides. */
static dgfem_status make_prism(const pencil *o, dgfem_polyhedron **out) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_vec3 vertices[2 * SIDES];
    int start[SIDES + 3] = {0, SIDES, 2 * SIDES}, corners[6 * SIDES];
    for (int i = 0; i < SIDES; i++) {
        int next = (i + 1) % SIDES, side[4] = {i, next, SIDES + next, SIDES + i};
        vertices[i] = turned(vector(0, o->radius, 0), turn * i / SIDES);
        vertices[SIDES + i] = vertices[i];
        vertices[SIDES + i].x = (dgfem_real)o->length;
        corners[i] = SIDES - 1 - i, corners[SIDES + i] = SIDES + i;
        for (int k = 0; k < 4; k++) corners[2 * SIDES + 4 * i + k] = side[k];
        start[i + 3] = 2 * SIDES + 4 * (i + 1);
    }
    desc.vertices = vertices, desc.vertex_count = 2 * SIDES;
    desc.face_count = SIDES + 2, desc.loop_start = start, desc.loop_vertices = corners;
    desc.hooks = program_hooks();
    return dgfem_polyhedron_create(&desc, out);
}

/* Springs at four points hold the pencil, far from the point that is to be made. */
static dgfem_status hold(pencil *o, dgfem_body *body) {
    dgfem_status status = DGFEM_OK;
    for (int k = 0; !status && k < PINS; k++) {
        o->places[k] = turned(vector(k % 2 ? 0.7 * o->length : 0, 0.6 * o->radius, 0), turn * k / PINS);
        status = dgfem_body_pin(body, 0, o->places[k], DGFEM_R(2e3), &o->pins[k]);
    }
    return status;
}

static dgfem_status make_body(pencil *o, dgfem_body **out) {
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_shape_desc table = dgfem_default_shape_desc();
    dgfem_polyhedron *prism = NULL;
    dgfem_status status = make_prism(o, &prism);
    weld.hooks = desc.hooks = program_hooks();
    if (!status) status = dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&prism, 1, &weld, &desc.mesh);
    dgfem_polyhedron_destroy(prism);
    if (status) return status;
    desc.material.young = DGFEM_R(1e7); /* Pa; soft wood, so that the table need not be stiff */
    desc.material.density = 600;
    status = dgfem_body_create(&desc, out);
    if (status) return dgfem_mesh_destroy(desc.mesh), status;
    table.plane.normal.z = 1;
    table.plane.offset = (dgfem_real)(-7 * o->radius);
    status = dgfem_body_add_plane(*out, &table, NULL);
    return status ? status : hold(o, *out);
}

/* ---- sharpening ---- */

/* The blade, below the pencil's axis, touches the cone whose tip comes nearer in each round.

        ------------------------------+
                                  . ' |      the axis is above, the shavings fall down
        -----------------------.-'----+                                                      */
static dgfem_plane blade(const pencil *o, int round) {
    double half = o->angle * turn / 720, back = (o->rounds - 1 - round) * 1.2 * o->radius;
    dgfem_plane plane;
    plane.normal = vector(sin(half), 0, -cos(half));
    plane.offset = (dgfem_real)(sin(half) * (o->length + back / 2));
    return plane;
}

static dgfem_status step(const pencil *o, dgfem_body *body, double angle) {
    dgfem_status status = DGFEM_OK;
    for (int k = 0; !status && k < PINS; k++) status = dgfem_body_drag(body, o->pins[k], turned(o->places[k], angle));
    return status ? status : dgfem_body_step(body, (dgfem_real)o->dt, NULL);
}

static dgfem_status sharpen(const pencil *o, dgfem_body *body) {
    dgfem_cut_desc desc = dgfem_default_cut_desc();
    dgfem_status status = DGFEM_OK;
    desc.snap = DGFEM_R(1e-4), desc.sliver = 0; /* shavings may be thin beside the pencil */
    int per_round = (o->cuts + o->rounds - 1) / o->rounds;
    for (int cut = 0; !status && cut < o->cuts; cut++) {
        double before = turn * cut / per_round;
        status = dgfem_body_cut_plane(body, blade(o, cut / per_round), &desc, NULL);
        for (int i = 1; !status && i <= o->steps; i++) status = step(o, body, before + turn / per_round * i / o->steps);
    }
    return status;
}

/* ---- output ---- */

static dgfem_vec3 deformed(void *user, int element, int vertex) {
    const dgfem_body *body = (const dgfem_body *)user;
    dgfem_vec3 x = body->mesh->vertices[vertex], u = dgfem_body_displacement(body, element, x);
    return vector((double)(x.x + u.x), (double)(x.y + u.y), (double)(x.z + u.z));
}

static int write_vtu(const char *path, const dgfem_body *body) {
    formats_error error;
    if (formats_write_vtu(path, body->mesh, deformed, (void *)(size_t)body, NULL, 0, &error)) return 1;
    fprintf(stderr, "%s\n", error.text);
    return 0;
}

/* The point of a triangle with these weights at its second and third corner. */
static dgfem_vec3 point_in(const dgfem_vec3 corners[3], double b, double c) {
    double a = 1 - b - c;
    return vector(a * (double)corners[0].x + b * (double)corners[1].x + c * (double)corners[2].x,
                  a * (double)corners[0].y + b * (double)corners[1].y + c * (double)corners[2].y,
                  a * (double)corners[0].z + b * (double)corners[1].z + c * (double)corners[2].z);
}

/* A triangle of a cut in small parts, each wood or lead by its rest distance from the axis. */
static void paint_cut(const pencil *o, picture *p, const dgfem_vec3 rest[3], const dgfem_vec3 now[3]) {
    enum { PARTS = 24 };
    static const int corners[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 0}, {1, 1}, {0, 1}}};
    for (int i = 0; i < PARTS; i++)
        for (int k = 0; k < 2 * (PARTS - i) - 1; k++) {
            dgfem_vec3 part[3];
            double r = 0;
            for (int c = 0; c < 3; c++) {
                double u = (double)(i + corners[k % 2][c][0]) / PARTS,
                       v = (double)(k / 2 + corners[k % 2][c][1]) / PARTS;
                dgfem_vec3 x = point_in(rest, u, v);
                part[c] = point_in(now, u, v);
                r += hypot((double)x.y, (double)x.z) / 3;
            }
            picture_add_triangle(p, part, r < o->lead ? picture_rgb(60, 60, 65) : picture_rgb(250, 210, 160));
        }
}

static int write_picture(const pencil *o, const dgfem_body *body) {
    const picture_color paint = picture_rgb(255, 200, 40);
    dgfem_surface *surface;
    picture p;
    memset(&p, 0, sizeof p);
    if (dgfem_surface_create(body, &surface)) return 0;
    if (dgfem_surface_update(surface, body)) return dgfem_surface_destroy(surface), 0;
    double z = -7 * o->radius;
    picture_add_parallelogram(&p, vector(-0.1 * o->length, -0.2 * o->length, z), vector(1.4 * o->length, 0, 0),
                              vector(0, 0.5 * o->length, 0), picture_rgb(225, 230, 235));
    for (int t = 0; t < surface->triangle_count; t++) {
        dgfem_vec3 rest[3], now[3];
        int is_end = 1;
        for (int k = 0; k < 3; k++) {
            int v = surface->triangles[3 * t + k];
            rest[k] = surface->embedding->samples[surface->sample[v]], now[k] = surface->positions[v];
            is_end = is_end && ((double)rest[k].x < 1e-6 || (double)rest[k].x > o->length - 1e-6);
        }
        if (is_end || body->mesh->faces[surface->face[t]].cut) paint_cut(o, &p, rest, now);
        else picture_add_triangle(&p, now, paint);
    }
    dgfem_surface_destroy(surface);
    return picture_write(&p, o->ply);
}

/* One `key value` pair per line. */
static dgfem_status print_figures(const pencil *o, const dgfem_body *body, double volume, double seconds) {
    dgfem_real kept = 0;
    dgfem_piece *pieces = (dgfem_piece *)malloc((size_t)body->mesh->element_count * sizeof *pieces);
    int count = 0;
    if (!pieces) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_body_pieces(body, NULL, pieces, body->mesh->element_count, &count);
    for (int k = 0; k < count; k++)
        if (pieces[k].volume > kept) kept = pieces[k].volume;
    free(pieces);
    double whole = (double)dgfem_mesh_volume(body->mesh);
    printf("planes %d\nelements %d\npieces %d\n", o->cuts, body->mesh->element_count, count);
    printf("volume_before %.9g\nvolume_kept %.9g\nvolume_cut %.9g\n", volume, (double)kept, whole - (double)kept);
    printf("volume_change %.2g\nseconds %.3f\n", whole / volume - 1, seconds);
    return status;
}

int main(int argc, char **argv) {
    pencil o = read_options(argc, argv);
    dgfem_body *body = NULL;
    dgfem_status status = make_body(&o, &body);
    double start = program_seconds(), volume = status ? 0 : (double)dgfem_mesh_volume(body->mesh);
    if (!status) status = sharpen(&o, body);
    if (!status) status = print_figures(&o, body, volume, program_seconds() - start);
    int ok = !status && (!o.vtu || write_vtu(o.vtu, body)) && (!o.ply || write_picture(&o, body));
    if (status) fprintf(stderr, "pencil: %s\n", dgfem_status_text(status));
    dgfem_body_destroy(body);
    return ok ? 0 : 1;
}
