/* The examples' file formats: what they write and read, and that no file, however broken, harms them. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"

#include "formats_read.c"
#include "formats_write.c"

#include "check_files.h"

/* ---- files of the test ---- */

/* Reads bytes as a file of that name. */
static int read_bytes(const char *name, const void *data, size_t size, formats_surface *surface, formats_error *error) {
    int ok;
    write_file(name, data, size);
    error->text[0] = '\0';
    ok = formats_read_surface(path_in_folder(name), surface, error);
    assert_int_equal(remove(path), 0);
    return ok;
}

/* The text of the file, to be freed. */
static char *read_text(const char *name) {
    FILE *file = fopen(path_in_folder(name), "rb");
    char *text = (char *)calloc(1 << 20, 1);
    assert_non_null(file);
    assert_non_null(text);
    assert_true(fread(text, 1, (1 << 20) - 1, file) < (1 << 20) - 1);
    fclose(file);
    assert_int_equal(remove(path), 0);
    return text;
}

/* ---- surfaces ---- */

static double signed_volume(const formats_surface *s) {
    double sum = 0;
    for (int t = 0; t < s->triangle_count; t++) {
        const double *a = s->vertices + 3 * s->triangles[3 * t], *b = s->vertices + 3 * s->triangles[3 * t + 1],
                     *c = s->vertices + 3 * s->triangles[3 * t + 2];
        sum += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    return sum / 6;
}

static void check_sound(const formats_surface *s) {
    assert_true(s->triangle_count > 0);
    for (int i = 0; i < 3 * s->triangle_count; i++) assert_in_range(s->triangles[i], 0, s->vertex_count - 1);
    for (int i = 0; i < 3 * s->vertex_count; i++) assert_true(isfinite(s->vertices[i]));
}

static void check_box(const char *name, const void *data, size_t size, double volume) {
    formats_surface s;
    formats_error error;
    if (!read_bytes(name, data, size, &s, &error)) {
        print_error("%s\n", error.text);
        fail();
    }
    assert_int_equal(s.vertex_count, 8);
    assert_int_equal(s.triangle_count, 12);
    check_sound(&s);
    check_near(signed_volume(&s), volume, 1e-12);
    formats_free_surface(&s);
}

static void check_box_text(const char *name, const char *text) { check_box(name, text, strlen(text), 6); }

/* A box of 1 x 2 x 3. */
static const double box_vertices[8][3] = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {1, 2, 0},
                                          {0, 0, 3}, {1, 0, 3}, {0, 2, 3}, {1, 2, 3}};
static const int box_quads[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

#define BOX_OBJ_VERTICES "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 1 2 0\nv 0 0 3\nv 1 0 3\nv 0 2 3\nv 1 2 3\n"
#define BOX_OFF_VERTICES "0 0 0\n1 0 0\n0 2 0\n1 2 0\n0 0 3\n1 0 3\n0 2 3\n1 2 3\n"
#define BOX_OFF_FACES "4 0 4 6 2\n4 1 3 7 5\n4 0 1 5 4\n4 2 6 7 3\n4 0 2 3 1\n4 4 5 7 6\n"

static const char box_obj[] =
    "# a box\n" BOX_OBJ_VERTICES "f 1 5 7 3\nf 2/1 4/2 8/3 6/4\nf 1//1 2//1 6//1 5//1\nf 3/1/1 7/1/1 8/1/1 4/1/1\n"
    "f -8 -6 -5 -7\nf 5 6 8 7\n";
static const char box_off[] = "OFF\n# a box\n8 6 12\n" BOX_OFF_VERTICES BOX_OFF_FACES;
static const char box_ply[] =
    "ply\nformat ascii 1.0\ncomment a box\nelement vertex 8\nproperty float x\nproperty float y\n"
    "property float z\nelement face 6\nproperty list uchar int vertex_indices\n"
    "end_header\n" BOX_OFF_VERTICES BOX_OFF_FACES;

static void reads_obj(void **state) {
    (void)state;
    check_box_text("box.obj", box_obj);
    check_box_text("box.OBJ", box_obj);
    check_box_text("box", box_obj);
    check_box_text("box.obj", "f 1 5 7 3\nf 2 4 8 6\nf 1 2 6 5\r\nf 3 7 8 4 # four\nf 1 3 4 2\nf 5 6 \\\n 8 7\n"
                              "vt 0 0\nusemtl nan\n" BOX_OBJ_VERTICES);
    check_box_text("box.obj", "o box\nvn 0 0 1\n" BOX_OBJ_VERTICES "f 1 5 7 3\nf 2 4 8 6\n   f 1 2 6 5\n"
                              "f 3 7 8 4\nl 1 2\nf 1 3 4 2\nf 5 6 8 7");
}

static void reads_off(void **state) {
    (void)state;
    check_box_text("box.off", box_off);
    check_box_text("box", box_off);
    check_box_text("box.off", "OFF 8 6 0\n" BOX_OFF_VERTICES "4 0 4 6 2 255 0 0\n4 1 3 7 5\n4 0 1 5 4 # here\n\n"
                              "4 2 6 7 3\n4 0 2 3 1\n4 4 5 7 6 0.5 0.5 0.5 1\n");
    check_box_text(
        "box.off",
        "COFF\n8 6\n0 0 0 255 0 0 255\n1 0 0 1 1 1 1\n0 2 0\n1 2 0\n0 0 3\n1 0 3\n0 2 3\n1 2 3\n" BOX_OFF_FACES);
}

/* A PLY file in bytes: numbers little or big endian. */
typedef struct bytes {
    unsigned char data[4096];
    size_t size;
    int is_big;
} bytes;

static void put_text(bytes *b, const char *text) {
    memcpy(b->data + b->size, text, strlen(text));
    b->size += strlen(text);
}

static void put_bits(bytes *b, uint64_t bits, int size) {
    for (int i = 0; i < size; i++) b->data[b->size++] = (unsigned char)(bits >> 8 * (b->is_big ? size - 1 - i : i));
}

static void put_float(bytes *b, double value) {
    float single = (float)value;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    put_bits(b, bits, 4);
}

static void put_double(bytes *b, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_bits(b, bits, 8);
}

/* Mixed types, unused properties and elements before, between and behind. */
static void make_binary_ply(bytes *b, int is_big) {
    memset(b, 0, sizeof *b);
    b->is_big = is_big;
    put_text(b, is_big ? "ply\r\nformat binary_big_endian 1.0\r\n" : "ply\nformat binary_little_endian 1.0\n");
    put_text(b, "element nothing 2000000000\nelement camera 1\nproperty list char short marks\nproperty short pose\n");
    put_text(b, "element vertex 8\nproperty uchar red\nproperty double x\nproperty float y\nproperty int16 z\n");
    put_text(b, "element face 6\nproperty float32 quality\nproperty list uint8 uint vertex_index\nproperty uint u\n");
    put_text(b, "element edge 1\nproperty int a\nend_header\n");
    put_bits(b, 2, 1), put_bits(b, 1, 2), put_bits(b, 2, 2), put_bits(b, 3, 2);
    for (int i = 0; i < 8; i++) {
        put_bits(b, 255, 1);
        put_double(b, box_vertices[i][0]);
        put_float(b, -box_vertices[i][1]);
        put_bits(b, (uint64_t)(int64_t)-box_vertices[i][2], 2);
    }
    for (int f = 0; f < 6; f++) {
        put_float(b, 0.5);
        put_bits(b, 4, 1);
        for (int k = 0; k < 4; k++) put_bits(b, (uint64_t)box_quads[f][k], 4);
        put_bits(b, 0xffffffffu, 4);
    }
    put_bits(b, 7, 4);
}

static void reads_ply(void **state) {
    bytes b;
    (void)state;
    check_box_text("box.ply", box_ply);
    check_box_text("box", box_ply);
    for (int is_big = 0; is_big < 2; is_big++) {
        make_binary_ply(&b, is_big);
        check_box("box.ply", b.data, b.size, 6); /* y and z are mirrored: the volume keeps its sign */
    }
}

static void make_binary_stl(bytes *b, const char *header) {
    memset(b, 0, sizeof *b);
    memcpy(b->data, header, strlen(header));
    b->size = 80;
    put_bits(b, 12, 4);
    for (int t = 0; t < 12; t++) {
        static const int fan[2][3] = {{0, 1, 2}, {0, 2, 3}};
        for (int k = 0; k < 3; k++) put_float(b, 0);
        for (int k = 0; k < 3; k++) {
            const double *v = box_vertices[box_quads[t / 2][fan[t % 2][k]]];
            for (int axis = 0; axis < 3; axis++) put_float(b, v[axis] == 0 && t % 2 ? -0.0 : v[axis]);
        }
        put_bits(b, 0, 2);
    }
}

static void reads_stl(void **state) {
    bytes b;
    char text[8192] = "solid a box\n";
    (void)state;
    make_binary_stl(&b, "binary");
    check_box("box.stl", b.data, b.size, 6);
    check_box("box", b.data, b.size, 6);
    make_binary_stl(&b, "solid");
    check_box("box.stl", b.data, b.size, 6);
    for (int t = 0; t < 12; t++) {
        const int *q = box_quads[t / 2];
        strcat(text, " facet normal 0 0 0\n  outer loop\n");
        for (int k = 0; k < 3; k++) {
            const double *v = box_vertices[q[k == 0 ? 0 : k + t % 2]];
            snprintf(text + strlen(text), sizeof text - strlen(text), "   vertex %g %g %e\r\n", v[0], v[1], v[2]);
        }
        strcat(text, "  endloop\n endfacet\n");
    }
    strcat(text, "endsolid\n");
    check_box_text("box.stl", text);
    check_box_text("box", text);
}

/* ---- bad files ---- */

static void check_refused(const char *name, const void *data, size_t size, const char *message) {
    formats_surface s;
    formats_error error;
    if (read_bytes(name, data, size, &s, &error)) {
        print_error("%s: accepted, instead of \"%s\"\n", name, message);
        fail();
    }
    assert_null(s.vertices);
    assert_null(s.triangles);
    if (!strstr(error.text, message) || !strstr(error.text, name) || strchr(error.text, '\n')) {
        print_error("\"%s\" instead of \"%s\"\n", error.text, message);
        fail();
    }
}

static void check_text_refused(const char *name, const char *text, const char *message) {
    check_refused(name, text, strlen(text), message);
}

static void refuses_bad_obj(void **state) {
    (void)state;
    check_text_refused("a.obj", "", "is empty");
    check_text_refused("a.obj", "\n\n", "holds no triangles");
    check_text_refused("a.obj", BOX_OBJ_VERTICES, "holds no triangles");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 2 9\n", "line 9: face 0: there is no such vertex (there are 8)");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 2 3\nf 1 2 0\n", "line 10: face 1: there is no such vertex");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 2 -9\n", "line 9: face 0: there is no such vertex");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 2 2147483648\n", "line 9: \"2147483648\" is out of range");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 2 -99999999999999999999\n", "is out of range");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 2\n", "line 9: face 0 has 2 corners");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f\n", "line 9: face 0 has 0 corners");
    check_text_refused("a.obj", BOX_OBJ_VERTICES "f 1 x 3\n", "line 9: \"x\" is not a whole number");
    check_text_refused("a.obj", "v 0 0\nf 1 1 1\n", "line 1: a number is missing");
    check_text_refused("a.obj", "v 0 0 zero\nf 1 1 1\n", "line 1: \"zero\" is not a number");
    check_text_refused("a.obj", "v 0 nan 0\nf 1 1 1\n", "line 1: a coordinate is NaN or infinite");
    check_text_refused("a.obj", "v 0 0 0\nv 0 0 1e999\nf 1 2 1\n", "line 2: a coordinate is NaN or infinite");
    check_refused("a.obj", "v 0 0 0\nv 1 \0 0\nf 1 2 1\n", 24, "line 2: \"\" is not a number");
}

static void refuses_bad_off(void **state) {
    (void)state;
    check_text_refused("a.off", "8 6 0\n", "not an OFF file");
    check_text_refused("a.off", "OFF", "the counts are missing");
    check_text_refused("a.off", "OFF BINARY\n", "binary OFF is not supported");
    check_text_refused("a.off", "OFF\n8\n", "line 2: an index or count is missing");
    check_text_refused("a.off", "OFF\n-1 2 0\n", "line 2: \"-1\" is out of range");
    check_text_refused("a.off", "OFF\n2000000000 2 0\n0 0 0\n", "ends after 1 of 2000000000 vertices");
    check_text_refused("a.off", "OFF\n3 2000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
                       "ends after 1 of 2000000000 faces");
    check_text_refused("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6: \"3\" is out of range");
    check_text_refused("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2000000000 0 1 2\n",
                       "line 6: an index or count is miss");
    check_text_refused("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "line 6: face 0 has 2 corners");
    check_text_refused("a.off", "OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n",
                       "line 4: a coordinate is NaN or infinite");
    check_text_refused("a.off", "OFF\n0 1 0\n3 0 1 2\n", "line 3: \"0\" is out of range");
}

#define PLY_HEADER(format, vertices, faces)                                                                            \
    "ply\nformat " format " 1.0\nelement vertex " vertices                                                             \
    "\nproperty float x\nproperty float y\nproperty float z\nelement face " faces                                      \
    "\nproperty list uchar int vertex_indices\nend_header\n"

static void refuses_bad_ply(void **state) {
    bytes b;
    (void)state;
    check_text_refused("a.ply", "ply\n", "the line \"format\" is missing");
    check_text_refused("a.ply", "ply\nformat morse 1.0\n", "line 2: unknown format");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "ends within the header");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nproperty float x\n", "line 3: a property before any element");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nbogus\n", "line 3: unknown line in the header");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty quaternion x\n", "unknown type");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nelement face 1\nproperty list float int vertex_indices\n",
                       "a list is counted by a whole number");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nelement face 1\nproperty list int float vertex_indices\n",
                       "a vertex index is a whole number");
    check_text_refused("a.ply", "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n",
                       "one x, y and z");
    check_text_refused("a.ply",
                       "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
                       "end_header\n",
                       "one list vertex_indices");
    check_text_refused("a.ply", PLY_HEADER("ascii", "-1", "1"), "line 3: \"-1\" is out of range");
    check_text_refused("a.ply", PLY_HEADER("ascii", "99999999999999999999", "1"), "is out of range");
    check_text_refused("a.ply", PLY_HEADER("ascii", "2000000000", "1") "0 0 0\n", "line 11: ends too early");
    check_text_refused("a.ply", PLY_HEADER("binary_little_endian", "2000000000", "1") "0123456789abcdef",
                       "ends too early");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "1") "0 0 0\n3 0 0 1\n",
                       "triangle 0: no vertex 1 (there are 1)");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "1") "0 0 0\n3 0 0 -1\n", "face 0: no such vertex");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "1") "0 0 0\n3 0 0 0.5\n", "face 0: no such vertex");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "1") "0 0 0\n-3 0 0 0\n", "bad length of a list");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "1") "0 0 0\n2 0 0\n", "face 0 has 2 corners");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "1") "0 0 nan\n3 0 0 0\n", "a coordinate is NaN or infinite");
    check_text_refused("a.ply", PLY_HEADER("ascii", "1", "0") "0 0 0\n", "holds no triangles");
    make_binary_ply(&b, 0);
    b.size -= 5;
    check_refused("a.ply", b.data, b.size, "ends too early");
}

static void refuses_bad_stl(void **state) {
    bytes b;
    (void)state;
    check_text_refused("a.stl", "short", "at least 84 bytes");
    make_binary_stl(&b, "binary");
    check_refused("a.stl", b.data, b.size - 1, "announces 12 triangles");
    memset(b.data + 80, 255, 4);
    check_refused("a.stl", b.data, b.size, "announces 4294967295 triangles, but its 684 bytes hold only 12");
    check_refused("a.stl", b.data, 84, "announces 4294967295 triangles, but its 84 bytes hold only 0");
    memset(b.data + 80, 0, 4);
    check_refused("a.stl", b.data, 84, "holds no triangles");
    make_binary_stl(&b, "binary");
    memcpy(b.data + 84 + 50 + 12, "\0\0\xc0\x7f", 4); /* NaN */
    check_refused("a.stl", b.data, b.size, "face 1: a coordinate is NaN or infinite");
    check_text_refused("a.stl", "solid\nendsolid\n", "holds no triangles");
    check_text_refused("a.stl", "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\n",
                       "line 6: \"vertex\" is missing");
    check_text_refused("a.stl", "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0\n", "line 4: a number is missing");
    check_text_refused("a.stl", "solid\nbanana\n", "line 2: \"facet\" is missing");
}

static void refuses_other_files(void **state) {
    formats_surface s;
    formats_error error;
    (void)state;
    check_text_refused("a.txt", "Dear reader,\n", "is none of OBJ, PLY, STL, OFF");
    check_text_refused("a.txt", "\xff\xfe\n\t", "is none of OBJ, PLY, STL, OFF");
    assert_false(formats_read_surface(path_in_folder("absent.obj"), &s, &error));
    assert_non_null(strstr(error.text, "cannot be opened"));
    assert_false(formats_read_surface(folder, &s, &error)); /* a directory */
    assert_non_null(strstr(error.text, "cannot be "));
    assert_int_equal(mkdir(path_in_folder("folder.stl"), 0700), 0);
    assert_false(formats_read_surface(path, &s, &error));
    assert_int_equal(rmdir(path), 0);
}

/* Whatever comes out is sound, and otherwise there is one line of explanation. */
static void read_anything(const char *name, const void *data, size_t size) {
    formats_surface s;
    formats_error error;
    if (read_bytes(name, data, size, &s, &error)) check_sound(&s);
    else assert_true(error.text[0] && !strchr(error.text, '\n'));
    formats_free_surface(&s);
}

static void survives_truncation(void **state) {
    bytes ply, stl;
    const void *data[5];
    const char *const names[5] = {"a.obj", "a.off", "a.ply", "a.ply", "a.stl"};
    size_t sizes[5];
    (void)state;
    make_binary_ply(&ply, 0);
    make_binary_stl(&stl, "solid");
    data[0] = box_obj, data[1] = box_off, data[2] = box_ply, data[3] = ply.data, data[4] = stl.data;
    sizes[0] = strlen(box_obj), sizes[1] = strlen(box_off), sizes[2] = strlen(box_ply);
    sizes[3] = ply.size, sizes[4] = stl.size;
    for (int i = 0; i < 5; i++)
        for (size_t size = 1; size <= sizes[i]; size++) read_anything(names[i], data[i], size);
}

static void survives_fuzzing(void **state) {
    check_random random = check_random_seeded(20090615);
    bytes seeds[6];
    const char *const names[6] = {"a.obj", "a.off", "a.ply", "a.ply", "a.stl", "a.stl"};
    int rounds = check_long() ? 300000 : 20000;
    (void)state;
    memset(seeds, 0, sizeof seeds);
    put_text(&seeds[0], box_obj), put_text(&seeds[1], box_off), put_text(&seeds[2], box_ply);
    make_binary_ply(&seeds[3], 0);
    make_binary_stl(&seeds[4], "binary");
    put_text(&seeds[5], "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
                        "endfacet\nendsolid\n");
    for (int round = 0; round < rounds; round++) {
        int kind = check_random_int(&random, 6), edits = check_random_int(&random, 8);
        bytes b = seeds[kind];
        if (check_random_int(&random, 8) == 0) { /* noise behind a believable start */
            size_t keep = (size_t)check_random_int(&random, 24);
            b.size = 1 + (size_t)check_random_int(&random, 400);
            for (size_t i = keep; i < b.size; i++) b.data[i] = (unsigned char)check_random_bits(&random);
        }
        for (int i = 0; i < edits; i++) {
            static const char spice[] = "-0919999 \n\\#/.enaif\0\xff";
            size_t at = (size_t)check_random_int(&random, (int)b.size);
            switch (check_random_int(&random, 4)) {
            case 0: b.data[at] = (unsigned char)check_random_bits(&random); break;
            case 1: b.data[at] = (unsigned char)spice[check_random_int(&random, (int)sizeof spice)]; break;
            case 2:
                memset(b.data + at, check_random_int(&random, 2) ? 255 : 0, b.size - at < 4 ? b.size - at : 4);
                break;
            default: b.size = at ? at : 1;
            }
        }
        read_anything(names[kind], b.data, b.size);
    }
}

/* ---- writing ---- */

static void check_same_surface(const formats_surface *s, const double *vertices, int vertex_count, const int *triangles,
                               int triangle_count) {
    assert_int_equal(s->vertex_count, vertex_count);
    assert_int_equal(s->triangle_count, triangle_count);
    assert_memory_equal(s->vertices, vertices, 3 * (size_t)vertex_count * sizeof(double));
    assert_memory_equal(s->triangles, triangles, 3 * (size_t)triangle_count * sizeof(int));
}

static void writes_obj_and_ply(void **state) {
    enum { VERTICES = 40, TRIANGLES = 60 };
    check_random random = check_random_seeded(7);
    struct {
        float p[3];
        float gap;
    } strided[VERTICES];
    double exact[3 * VERTICES], rounded[3 * VERTICES], normals[3 * VERTICES];
    int triangles[3 * TRIANGLES];
    unsigned char colors[3 * VERTICES];
    dgfem_points_in none, floats;
    formats_surface s;
    formats_error error;
    (void)state;
    for (int i = 0; i < 3 * VERTICES; i++) {
        exact[i] = check_random_real(&random, -1e3, 1e3);
        normals[i] = check_random_real(&random, -1, 1);
        strided[i / 3].p[i % 3] = (float)exact[i];
        rounded[i] = (double)(float)exact[i];
        colors[i] = (unsigned char)i;
    }
    for (int i = 0; i < 3 * TRIANGLES; i++) triangles[i] = check_random_int(&random, VERTICES);
    none = dgfem_points_in_double(NULL, 0);
    floats = dgfem_points_in_float(strided[0].p, VERTICES);
    floats.stride = (int)sizeof strided[0];
    for (int with_normals = 0; with_normals < 2; with_normals++) {
        dgfem_points_in n = with_normals ? dgfem_points_in_double(normals, VERTICES) : none;
        path_in_folder("a.obj");
        assert_true(formats_write_obj(path, dgfem_points_in_double(exact, VERTICES), n, triangles, TRIANGLES, &error));
        assert_true(formats_read_surface(path, &s, &error));
        check_same_surface(&s, exact, VERTICES, triangles, TRIANGLES);
        formats_free_surface(&s);
        assert_true(formats_write_obj(path, floats, n, triangles, TRIANGLES, &error));
        assert_true(formats_read_surface(path, &s, &error));
        for (int i = 0; i < 3 * VERTICES; i++) assert_true((float)s.vertices[i] == (float)rounded[i]);
        formats_free_surface(&s);
        assert_int_equal(remove(path), 0);
        path_in_folder("a.ply");
        assert_true(formats_write_ply(path, floats, n, with_normals ? colors : NULL, triangles, TRIANGLES, &error));
        assert_true(formats_read_surface(path, &s, &error));
        check_same_surface(&s, rounded, VERTICES, triangles, TRIANGLES);
        formats_free_surface(&s);
        assert_int_equal(remove(path), 0);
    }
    assert_false(formats_write_obj("/no/such/folder/a.obj", floats, none, triangles, TRIANGLES, &error));
    assert_non_null(strstr(error.text, "/no/such/folder/a.obj: cannot be written"));
}

/* A square tube, outside 4 x 4, inside 2 x 2, 1 high: its ends are faces with a hole. The mesh is filled in by hand,
   with a second element, a 2 x 2 x 1 plug, in the hole. */
typedef struct tube {
    dgfem_mesh mesh;
    dgfem_vec3 vertices[16];
    dgfem_face faces[12];
    dgfem_element elements[2];
    dgfem_loop loops[14];
    int loop_vertices[56], element_faces[16];
} tube;

static void tube_loop(tube *t, int a, int b, int c, int d) {
    int *v = t->loop_vertices + t->mesh.loop_vertex_count;
    t->mesh.loops[t->mesh.loop_count].start = t->mesh.loop_vertex_count;
    t->mesh.loops[t->mesh.loop_count++].count = 4;
    v[0] = a, v[1] = b, v[2] = c, v[3] = d;
    t->mesh.loop_vertex_count += 4;
}

static void tube_face(tube *t, int inside, int outside, int loops) {
    dgfem_face *f = &t->faces[t->mesh.face_count++];
    f->element[0] = inside, f->element[1] = outside;
    f->loop_start = t->mesh.loop_count - loops, f->loop_count = loops;
}

static void make_tube(tube *t) {
    memset(t, 0, sizeof *t);
    t->mesh.vertices = t->vertices, t->mesh.faces = t->faces, t->mesh.elements = t->elements, t->mesh.loops = t->loops;
    t->mesh.loop_vertices = t->loop_vertices, t->mesh.element_faces = t->element_faces;
    t->mesh.vertex_count = 16, t->mesh.element_count = 2;
    for (int i = 0; i < 16; i++) { /* 0..3 bottom outside, 4..7 top outside, 8..11 and 12..15 inside */
        static const int x[4] = {-1, 1, 1, -1}, y[4] = {-1, -1, 1, 1};
        int size = i < 8 ? 2 : 1;
        t->vertices[i].x = (dgfem_real)(size * x[i % 4]);
        t->vertices[i].y = (dgfem_real)(size * y[i % 4]);
        t->vertices[i].z = (dgfem_real)(i / 4 % 2);
    }
    tube_loop(t, 3, 2, 1, 0), tube_loop(t, 8, 9, 10, 11), tube_face(t, 0, DGFEM_NONE, 2);   /* 0: bottom */
    tube_loop(t, 4, 5, 6, 7), tube_loop(t, 15, 14, 13, 12), tube_face(t, 0, DGFEM_NONE, 2); /* 1: top */
    for (int k = 0; k < 4; k++) {
        int m = (k + 1) % 4;
        tube_loop(t, k, m, 4 + m, 4 + k), tube_face(t, 0, DGFEM_NONE, 1); /* 2, 4, 6, 8: outer walls */
        tube_loop(t, 8 + k, 12 + k, 12 + m, 8 + m),
            tube_face(t, 0, 1, 1); /* 3, 5, 7, 9: out of the tube, into the plug */
    }
    tube_loop(t, 11, 10, 9, 8), tube_face(t, 1, DGFEM_NONE, 1);   /* 10: the plug's bottom */
    tube_loop(t, 12, 13, 14, 15), tube_face(t, 1, DGFEM_NONE, 1); /* 11: the plug's top */
    t->elements[0].face_count = 10, t->elements[1].face_start = 10, t->elements[1].face_count = 6;
    for (int k = 0; k < 10; k++) t->element_faces[k] = k;
    for (int k = 0; k < 4; k++) t->element_faces[10 + k] = 3 + 2 * k;
    t->element_faces[14] = 10, t->element_faces[15] = 11;
}

static void finds_the_boundary(void **state) {
    tube t;
    formats_surface s;
    formats_error error;
    int *faces;
    (void)state;
    make_tube(&t);
    assert_true(formats_mesh_boundary(&t.mesh, &s, &faces, &error));
    check_sound(&s);
    assert_int_equal(s.vertex_count, 16);
    assert_int_equal(s.triangle_count, 2 * 8 + 2 * 4 + 2 * 2);
    check_near(signed_volume(&s), 16, 1e-12);
    for (int i = 0; i < s.triangle_count; i++) assert_int_equal(t.faces[faces[i]].element[1], DGFEM_NONE);
    free(faces);
    formats_free_surface(&s);
}

/* Numbers of the first array of that name (or, with a NULL name, in <Points>); returns how many. */
static int vtu_numbers(const char *text, const char *name, double *out, int capacity) {
    char key[64];
    const char *s;
    int n = 0;
    if (name) snprintf(key, sizeof key, "Name=\"%s\"", name);
    s = strstr(text, name ? key : "<Points>\n");
    assert_non_null(s);
    s = strchr(name ? s : strchr(s, '\n'), '>') + 1;
    for (;;) {
        char *end;
        double value = strtod(s, &end);
        if (end == s) break;
        assert_true(n < capacity);
        out[n++] = value;
        s = end;
    }
    while (*s == '\n' || *s == ' ') s++;
    assert_memory_equal(s, "</DataArray>", 12);
    return n;
}

/* Every tag is closed by its own. */
static void check_xml(const char *text) {
    const char *stack[32];
    int depth = 0;
    for (const char *s = strchr(text, '<'); s; s = strchr(s + 1, '<')) {
        size_t n = strcspn(s + 1 + (s[1] == '/'), " >\n");
        if (s[1] == '?') continue;
        if (s[1] == '/') assert_true(depth > 0 && memcmp(stack[--depth], s + 2, n) == 0);
        else assert_true(depth < 32), stack[depth++] = s + 1;
    }
    assert_int_equal(depth, 0);
}

/* Volume of cell `cell` by its faces stream, which must be closed and seen from outside. */
static double vtu_cell_volume(const double *points, const double *faces, const double *offsets, int cell) {
    int at = cell ? (int)offsets[cell - 1] : 0, count = (int)faces[at++];
    double sum = 0;
    for (int f = 0; f < count; f++) {
        int corners = (int)faces[at++];
        const double *a = points + 3 * (int)faces[at];
        for (int k = 1; k + 1 < corners; k++) {
            const double *b = points + 3 * (int)faces[at + k], *c = points + 3 * (int)faces[at + k + 1];
            sum += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                   a[2] * (b[0] * c[1] - b[1] * c[0]);
        }
        at += corners;
    }
    assert_int_equal(at, (int)offsets[cell]);
    return sum / 6;
}

/* Elements drift apart and double in size. */
static dgfem_vec3 drifted(void *user, int element, int vertex) {
    dgfem_vec3 p = ((const tube *)user)->vertices[vertex];
    p.x = 2 * p.x + (dgfem_real)(10 * element), p.y *= 2, p.z *= 2;
    return p;
}

static void writes_vtu(void **state) {
    static double points[3 * 64], faces[512], offsets[8], ends[8], types[8], connectivity[64], displacement[3 * 64],
        cells[32];
    const double pressure[2] = {1.5, -2}, stress[18] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18};
    formats_cell_data data[2] = {{"pressure <\"&\">", 1, NULL}, {"stress", 9, NULL}};
    tube t;
    (void)state;
    data[0].values = pressure, data[1].values = stress;
    make_tube(&t);
    for (int moved = 0; moved < 2; moved++) {
        formats_error error;
        char *text;
        assert_true(formats_write_vtu(path_in_folder("a.vtu"), &t.mesh, moved ? drifted : NULL, &t, data, 2, &error));
        text = read_text("a.vtu");
        check_xml(text);
        assert_non_null(strstr(text, "NumberOfPoints=\"24\" NumberOfCells=\"2\""));
        assert_int_equal(vtu_numbers(text, NULL, points, 3 * 64), 3 * 24); /* 16 of the tube and 8 of the plug */
        assert_int_equal(vtu_numbers(text, "connectivity", connectivity, 64), 24);
        assert_int_equal(vtu_numbers(text, "offsets", offsets, 8), 2);
        assert_int_equal(vtu_numbers(text, "types", types, 8), 2);
        assert_int_equal(vtu_numbers(text, "faceoffsets", ends, 8), 2);
        assert_int_equal(vtu_numbers(text, "faces", faces, 512), (int)ends[1]);
        assert_true(offsets[0] == 16 && offsets[1] == 24 && types[0] == 42 && types[1] == 42);
        for (int i = 0; i < 24; i++) assert_true(connectivity[i] == i);
        check_near(vtu_cell_volume(points, faces, ends, 0), moved ? 96 : 12, 1e-12);
        check_near(vtu_cell_volume(points, faces, ends, 1), moved ? 32 : 4, 1e-12);
        assert_int_equal(vtu_numbers(text, "pressure &#60;&#34;&#38;&#34;&#62;", cells, 32), 2);
        assert_true(cells[0] == 1.5 && cells[1] == -2);
        assert_int_equal(vtu_numbers(text, "stress", cells, 32), 18);
        for (int i = 0; i < 18; i++) assert_true(cells[i] == i + 1);
        if (moved) {
            assert_int_equal(vtu_numbers(text, "displacement", displacement, 3 * 64), 3 * 24);
            for (int i = 0; i < 24; i++) check_near(displacement[3 * i + 2], points[3 * i + 2] / 2, 0);
            for (int i = 16; i < 24; i++) check_near(displacement[3 * i], (points[3 * i] + 10) / 2, 0);
        } else {
            assert_null(strstr(text, "displacement"));
        }
        free(text);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reads_obj),           cmocka_unit_test(reads_off),
        cmocka_unit_test(reads_ply),           cmocka_unit_test(reads_stl),
        cmocka_unit_test(refuses_bad_obj),     cmocka_unit_test(refuses_bad_off),
        cmocka_unit_test(refuses_bad_ply),     cmocka_unit_test(refuses_bad_stl),
        cmocka_unit_test(refuses_other_files), cmocka_unit_test(survives_truncation),
        cmocka_unit_test(survives_fuzzing),    cmocka_unit_test(writes_obj_and_ply),
        cmocka_unit_test(finds_the_boundary),  cmocka_unit_test(writes_vtu),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
