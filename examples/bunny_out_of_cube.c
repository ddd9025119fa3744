/* A cube, one element, is carved to a bunny: by planes that touch the bunny from many directions, which leaves its convex
   hull, and then by a fret saw along its outlines, as seen from several sides, which takes the hollows out.

   What comes off is put aside after each cut, and the body made anew without it. Writes the picture --ply (what is left,
   and the chips pushed away from it) and the elements --vtu. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "model.h"
#include "picture.h"
#include "program.h"

enum { MAX_SECTORS = 360 };

static const double turn = 6.28318530717958648;

typedef struct options {
    const char *model, *ply, *vtu;
    int planes, views, sectors;
    double push;
} options;

/* The body under the tools, and everything that has come off. */
typedef struct carving {
    formats_surface model;
    dgfem_body *body;
    dgfem_polyhedron **chips;
    int chip_count, chip_capacity, cuts;
    double chip_volume;
} carving;

static options read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "bunny_out_of_cube [--model FILE] [--planes 150] [--views 6] [--sectors 72]\n"
                              "  [--push 0.6] [--ply FILE] [--vtu FILE]");
    options o;
    o.model = program_text(&p, "--model", NULL);
    o.planes = program_int(&p, "--planes", 150, 0, 100000);
    o.views = program_int(&p, "--views", 6, 0, 100);
    o.sectors = program_int(&p, "--sectors", 72, 3, MAX_SECTORS); /* corners of an outline */
    o.push = program_real(&p, "--push", 0.6);                     /* how far chips are pushed away in the picture */
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

/* ---- the body ---- */

static dgfem_status make_body(dgfem_mesh *mesh, dgfem_body **out) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    desc.mesh = mesh;
    desc.solver = DGFEM_SOLVER_PCG; /* no factorization to prepare: nothing moves here */
    desc.hooks = program_hooks();
    dgfem_status status = dgfem_body_create(&desc, out);
    if (status) dgfem_mesh_destroy(mesh);
    return status;
}

static dgfem_status make_cube(carving *c) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh = NULL;
    desc.lower = vector(-0.6, -0.6, -0.1), desc.upper = vector(0.6, 0.6, 1.1);
    desc.hooks = program_hooks();
    dgfem_status status = dgfem_mesh_create_grid(&desc, &mesh);
    return status ? status : make_body(mesh, &c->body);
}

static int add_chip(carving *c, dgfem_polyhedron *chip) {
    if (c->chip_count == c->chip_capacity) {
        int capacity = 2 * c->chip_capacity + 64;
        void *grown = realloc(c->chips, (size_t)capacity * sizeof *c->chips);
        if (!grown) return dgfem_polyhedron_destroy(chip), 0;
        c->chips = (dgfem_polyhedron **)grown;
        c->chip_capacity = capacity;
    }
    c->chips[c->chip_count++] = chip;
    c->chip_volume += (double)dgfem_polyhedron_measure(chip).volume;
    return 1;
}

/* Elements of the largest piece go into `kept`, which the caller destroys; all others are chips. */
static dgfem_status sort_elements(carving *c, dgfem_polyhedron **kept, int *kept_count) {
    int n = c->body->mesh->element_count, count = 0, largest = 0;
    int *piece_of = (int *)malloc((size_t)n * sizeof *piece_of);
    dgfem_piece *pieces = (dgfem_piece *)malloc((size_t)n * sizeof *pieces);
    dgfem_status status = piece_of && pieces ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_body_pieces(c->body, piece_of, pieces, n, &count);
    for (int k = 0; k < count; k++)
        if (pieces[k].volume > pieces[largest].volume) largest = k;
    for (int e = 0; !status && e < n; e++) {
        dgfem_polyhedron *element = NULL;
        status = dgfem_mesh_element_polyhedron(c->body->mesh, e, &element);
        if (!status && piece_of[e] == largest) kept[(*kept_count)++] = element;
        else if (!status && !add_chip(c, element)) status = DGFEM_ERROR_MEMORY;
    }
    free(piece_of);
    free(pieces);
    return status;
}

/* Takes away what has come off. */
static dgfem_status clear_chips(carving *c) {
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_mesh *mesh = NULL;
    dgfem_body *next = NULL;
    int count = 0;
    dgfem_polyhedron **kept = (dgfem_polyhedron **)malloc((size_t)c->body->mesh->element_count * sizeof *kept);
    dgfem_status status = kept ? sort_elements(c, kept, &count) : DGFEM_ERROR_MEMORY;
    weld.hooks = program_hooks();
    if (!status) status = dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)kept, count, &weld, &mesh);
    if (!status) status = make_body(mesh, &next);
    for (int k = 0; k < count; k++) dgfem_polyhedron_destroy(kept[k]);
    free(kept);
    if (status) return status;
    dgfem_body_destroy(c->body);
    c->body = next;
    return DGFEM_OK;
}

/* ---- planes: the convex hull ---- */

static double reach(const formats_surface *model, dgfem_vec3 direction) {
    double most = -1e300;
    for (int v = 0; v < model->vertex_count; v++) {
        const double *x = model->vertices + 3 * v;
        most = fmax(most, (double)direction.x * x[0] + (double)direction.y * x[1] + (double)direction.z * x[2]);
    }
    return most;
}

/* Thin chips are wanted here. */
static dgfem_cut_desc fine_cut(void) {
    dgfem_cut_desc desc = dgfem_default_cut_desc();
    desc.snap = DGFEM_R(1e-4), desc.sliver = 0;
    return desc;
}

/* Directions evenly spread over the sphere, along a spiral. */
static dgfem_status carve_hull(const options *o, carving *c) {
    dgfem_cut_desc desc = fine_cut();
    dgfem_status status = DGFEM_OK;
    for (int k = 0; !status && k < o->planes; k++) {
        double height = 1 - (2 * k + 1.0) / o->planes, width = sqrt(1 - height * height), around = 2.39996323 * k;
        dgfem_plane plane;
        dgfem_cut_info info;
        plane.normal = vector(width * cos(around), width * sin(around), height);
        /* Each a little outside: many touch the same vertex, and would meet in one point. */
        plane.offset = (dgfem_real)(reach(&c->model, plane.normal) + 0.002 * fmod(0.618034 * k, 1));
        status = dgfem_body_cut_plane(c->body, plane, &desc, &info);
        if (status || !info.faces_cut) continue;
        c->cuts++;
        status = clear_chips(c);
    }
    return status;
}

/* ---- outlines ---- */

/* A point that an onlooker in the direction `across` from the z axis sees at the place a, z, at a depth. */
static dgfem_vec3 from_view(double across, double a, double z, double depth) {
    return vector(a * cos(across) - depth * sin(across), a * sin(across) + depth * cos(across), z);
}

/* Corners of an outline around the model as seen from its middle: each as far out as the surface gets within the sectors
   beside it. */
static void find_outline(const formats_surface *model, double across, int sectors, const double middle[2],
                         double radius[MAX_SECTORS]) {
    enum { PARTS = 12 }; /* points on each triangle's edges and inside */
    for (int s = 0; s < sectors; s++) radius[s] = 0.02;
    for (int t = 0; t < model->triangle_count; t++)
        for (int i = 0; i <= PARTS; i++)
            for (int k = 0; i + k <= PARTS; k++) {
                const double weights[3] = {(double)i / PARTS, (double)k / PARTS, (double)(PARTS - i - k) / PARTS};
                double x[3] = {0, 0, 0};
                for (int j = 0; j < 9; j++)
                    x[j % 3] += weights[j / 3] * model->vertices[3 * model->triangles[3 * t + j / 3] + j % 3];
                double a = x[0] * cos(across) + x[1] * sin(across) - middle[0], z = x[2] - middle[1];
                double place = (atan2(z, a) / turn + 1) * sectors, r = hypot(a, z);
                double out = 1 / cos(turn / (2 * sectors)); /* the edge between two corners lies further in */
                for (int end = 0; end < 2; end++) {
                    int s = ((int)floor(place) + end) % sectors;
                    radius[s] = fmax(radius[s], r * out);
                }
            }
}

static dgfem_status carve_outline(const options *o, carving *c, double across) {
    dgfem_cut_desc desc = fine_cut();
    double radius[MAX_SECTORS], middle[2] = {0, 0.4};
    dgfem_status status = DGFEM_OK;
    find_outline(&c->model, across, o->sectors, middle, radius);
    for (int s = 0; !status && s < o->sectors; s++) {
        int next = (s + 1) % o->sectors;
        dgfem_vec3 quad[4];
        for (int k = 0; k < 4; k++) {
            int corner = k == 0 || k == 3 ? s : next;
            double angle = turn * corner / o->sectors;
            quad[k] = from_view(across, middle[0] + radius[corner] * cos(angle),
                                middle[1] + radius[corner] * sin(angle), k < 2 ? -1 : 1);
        }
        status = dgfem_body_cut_polygon(c->body, dgfem_points_in_vec3(quad, 4), &desc, NULL);
        c->cuts++;
    }
    return status ? status : clear_chips(c);
}

/* ---- output ---- */

/* 0 on failure. */
static int paint_polyhedron(picture *p, const dgfem_polyhedron *polyhedron, dgfem_vec3 shift, picture_color color) {
    int ok = 1;
    for (int f = 0; ok && f < polyhedron->face_count; f++) {
        int first = polyhedron->face_loops[f], last = polyhedron->face_loops[f + 1], count = 0;
        int room = polyhedron->loop_start[last] - polyhedron->loop_start[first] + 2 * (last - first - 1);
        int *triangles = (int *)malloc(3 * (size_t)room * sizeof *triangles);
        ok = triangles && !dgfem_polyhedron_triangulate_face(polyhedron, f, triangles, room, &count);
        for (int t = 0; ok && t < count; t++) {
            dgfem_vec3 corners[3];
            for (int k = 0; k < 3; k++) {
                corners[k] = polyhedron->vertices[triangles[3 * t + k]];
                corners[k].x += shift.x, corners[k].y += shift.y, corners[k].z += shift.z;
            }
            picture_add_triangle(p, corners, color);
        }
        free(triangles);
    }
    return ok;
}

static int paint_body(picture *p, const dgfem_body *body) {
    formats_surface boundary;
    formats_error error;
    if (!formats_mesh_boundary(body->mesh, &boundary, NULL, &error)) return 0;
    for (int t = 0; t < boundary.triangle_count; t++) {
        dgfem_vec3 corners[3];
        for (int k = 0; k < 3; k++) {
            const double *x = boundary.vertices + 3 * boundary.triangles[3 * t + k];
            corners[k] = vector(x[0], x[1], x[2]);
        }
        picture_add_triangle(p, corners, picture_rgb(90, 150, 225));
    }
    formats_free_surface(&boundary);
    return 1;
}

static int write_picture(const options *o, const carving *c) {
    picture p;
    memset(&p, 0, sizeof p);
    int ok = paint_body(&p, c->body);
    for (int k = 0; ok && k < c->chip_count; k++) {
        dgfem_vec3 x = dgfem_polyhedron_measure(c->chips[k]).centroid;
        if (2 * (double)x.y < (double)x.x) continue; /* between the body and the viewer */
        double tone = (double)(k % 7) / 7;
        ok = paint_polyhedron(&p, c->chips[k],
                              vector(o->push * (double)x.x, o->push * (double)x.y, o->push * ((double)x.z - 0.5)),
                              picture_rgb((int)(235 - 25 * tone), (int)(200 - 30 * tone), (int)(150 - 40 * tone)));
    }
    if (ok) return picture_write(&p, o->ply);
    picture_free(&p);
    return 0;
}

static double model_volume(const formats_surface *model) {
    double six = 0;
    for (int t = 0; t < model->triangle_count; t++) {
        const int *corner = model->triangles + 3 * t;
        const double *a = model->vertices + 3 * corner[0], *b = model->vertices + 3 * corner[1];
        const double *c = model->vertices + 3 * corner[2];
        six += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    return six / 6;
}

/* One `key value` pair per line. */
static void print_figures(const carving *c, double cube, double hull, double seconds) {
    double carved = (double)dgfem_mesh_volume(c->body->mesh);
    printf("cuts %d\nchips %d\nelements %d\n", c->cuts, c->chip_count, c->body->mesh->element_count);
    printf("volume_cube %.6f\nvolume_hull %.6f\nvolume_carved %.6f\n", cube, hull, carved);
    printf("volume_model %.6f\nvolume_chips %.6f\nvolume_lost %.2g\n", model_volume(&c->model), c->chip_volume,
           cube - carved - c->chip_volume);
    printf("seconds %.3f\n", seconds);
}

int main(int argc, char **argv) {
    options o = read_options(argc, argv);
    carving c;
    formats_error error;
    memset(&c, 0, sizeof c);
    double start = program_seconds(), cube = 0, hull = 0;
    int ok = model_read(o.model, &c.model) && !make_cube(&c);
    if (ok) cube = (double)dgfem_mesh_volume(c.body->mesh);
    ok = ok && !carve_hull(&o, &c);
    if (ok) hull = (double)dgfem_mesh_volume(c.body->mesh);
    for (int view = 0; ok && view < o.views; view++) ok = !carve_outline(&o, &c, turn / 2 * view / o.views);
    if (ok) print_figures(&c, cube, hull, program_seconds() - start);
    if (ok && o.vtu) {
        ok = formats_write_vtu(o.vtu, c.body->mesh, NULL, NULL, NULL, 0, &error);
        if (!ok) fprintf(stderr, "%s\n", error.text);
    }
    if (ok && o.ply) ok = write_picture(&o, &c);
    for (int k = 0; k < c.chip_count; k++) dgfem_polyhedron_destroy(c.chips[k]);
    free(c.chips);
    dgfem_body_destroy(c.body);
    formats_free_surface(&c.model);
    return ok ? 0 : 1;
}
