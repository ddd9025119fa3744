#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "picture.h"

picture_color picture_rgb(int red, int green, int blue) {
    picture_color color;
    color.red = (unsigned char)red, color.green = (unsigned char)green, color.blue = (unsigned char)blue;
    return color;
}

static int grow(void **data, int capacity, size_t size) {
    void *grown = realloc(*data, (size_t)capacity * size);
    if (grown) *data = grown;
    return grown != NULL;
}

/* Room for so many more. */
static int reserve(picture *p, int vertices, int triangles) {
    int v = p->vertex_count + vertices, t = p->triangle_count + triangles;
    void *positions = p->positions, *normals = p->normals, *colors = p->colors, *corners = p->triangles;
    int ok = !p->is_incomplete;
    if (ok && v > p->vertex_capacity) {
        v += v / 2;
        ok = grow(&positions, v, sizeof *p->positions) && grow(&normals, v, sizeof *p->normals) &&
             grow(&colors, v, sizeof *p->colors);
        if (ok) p->vertex_capacity = v;
    }
    if (ok && t > p->triangle_capacity) {
        t += t / 2;
        ok = grow(&corners, t, 3 * sizeof *p->triangles);
        if (ok) p->triangle_capacity = t;
    }
    p->positions = (dgfem_vec3 *)positions, p->normals = (dgfem_vec3 *)normals;
    p->colors = (picture_color *)colors, p->triangles = (int *)corners;
    p->is_incomplete = !ok;
    return ok;
}

void picture_add_mesh(picture *p, const dgfem_vec3 *positions, const dgfem_vec3 *normals, int vertex_count,
                      const int *triangles, const int *wall, int triangle_count, picture_color color,
                      picture_color wall_color) {
    int first = p->vertex_count;
    if (!reserve(p, vertex_count, triangle_count)) return;
    for (int v = 0; v < vertex_count; v++) {
        p->positions[first + v] = positions[v];
        p->normals[first + v] = normals[v];
        p->colors[first + v] = color;
    }
    for (int i = 0; i < 3 * triangle_count; i++) {
        p->triangles[3 * p->triangle_count + i] = first + triangles[i];
        if (wall && wall[i / 3]) p->colors[first + triangles[i]] = wall_color;
    }
    p->vertex_count += vertex_count;
    p->triangle_count += triangle_count;
}

void picture_add_skin(picture *p, const dgfem_skin *skin, picture_color color, picture_color wall_color) {
    picture_add_mesh(p, skin->positions, skin->normals, skin->vertex_count, skin->triangles, skin->wall,
                     skin->triangle_count, color, wall_color);
}

void picture_add_surface(picture *p, const dgfem_surface *surface, picture_color color, picture_color wall_color) {
    picture_add_mesh(p, surface->positions, surface->normals, surface->vertex_count, surface->triangles, surface->wall,
                     surface->triangle_count, color, wall_color);
}

void picture_add_triangle(picture *p, const dgfem_vec3 corners[3], picture_color color) {
    static const int triangle[3] = {0, 1, 2};
    dgfem_vec3 a = corners[0], b = corners[1], c = corners[2], n, normals[3];
    dgfem_real ux = b.x - a.x, uy = b.y - a.y, uz = b.z - a.z, vx = c.x - a.x, vy = c.y - a.y, vz = c.z - a.z;
    n.x = uy * vz - uz * vy, n.y = uz * vx - ux * vz, n.z = ux * vy - uy * vx;
    dgfem_real length = (dgfem_real)sqrt((double)(n.x * n.x + n.y * n.y + n.z * n.z));
    if (length > 0) n.x /= length, n.y /= length, n.z /= length;
    for (int k = 0; k < 3; k++) normals[k] = n;
    picture_add_mesh(p, corners, normals, 3, triangle, NULL, 1, color, color);
}

void picture_add_parallelogram(picture *p, dgfem_vec3 a, dgfem_vec3 u, dgfem_vec3 v, picture_color color) {
    dgfem_vec3 corners[6] = {a, a, a, a, a, a};
    for (int k = 0; k < 6; k++) {
        int with_u = k == 1 || k == 2 || k == 4, with_v = k == 2 || k == 4 || k == 5;
        if (with_u) corners[k].x += u.x, corners[k].y += u.y, corners[k].z += u.z;
        if (with_v) corners[k].x += v.x, corners[k].y += v.y, corners[k].z += v.z;
    }
    picture_add_triangle(p, corners, color);
    picture_add_triangle(p, corners + 3, color);
}

int picture_write(picture *p, const char *path) {
    formats_error error;
    int ok = !p->is_incomplete;
    snprintf(error.text, sizeof error.text, "%s: out of memory", path);
    if (ok)
        ok = formats_write_ply(path, dgfem_points_in_vec3(p->positions, p->vertex_count),
                               dgfem_points_in_vec3(p->normals, p->vertex_count), &p->colors[0].red, p->triangles,
                               p->triangle_count, &error);
    if (!ok) fprintf(stderr, "%s\n", error.text);
    picture_free(p);
    return ok;
}

void picture_free(picture *p) {
    free(p->positions);
    free(p->normals);
    free(p->colors);
    free(p->triangles);
    memset(p, 0, sizeof *p);
}
