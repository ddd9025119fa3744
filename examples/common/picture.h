/* A coloured triangle surface that grows part by part and is written as one PLY file, to be rendered. */
#ifndef PICTURE_H
#define PICTURE_H

#include "formats.h"

typedef struct picture_color {
    unsigned char red, green, blue;
} picture_color;

/* Zero it before use. */
typedef struct picture {
    dgfem_vec3 *positions, *normals;
    picture_color *colors;
    int *triangles;
    int vertex_count, vertex_capacity, triangle_count, triangle_capacity;
    int is_incomplete; /* memory ran out */
} picture;

picture_color picture_rgb(int red, int green, int blue);

/* Adds a mesh, vertices in `color`, but in `wall_color` those of triangles that are walls (`wall` may be NULL: none). */
void picture_add_mesh(picture *p, const dgfem_vec3 *positions, const dgfem_vec3 *normals, int vertex_count,
                      const int *triangles, const int *wall, int triangle_count, picture_color color,
                      picture_color wall_color);

/* A skin and the boundary of a body as they are now. */
void picture_add_skin(picture *p, const dgfem_skin *skin, picture_color color, picture_color wall_color);
void picture_add_surface(picture *p, const dgfem_surface *surface, picture_color color, picture_color wall_color);

/* One flat triangle, and a flat parallelogram with the corners a, a + u, a + u + v, a + v; counter-clockwise from the side
   that is seen. */
void picture_add_triangle(picture *p, const dgfem_vec3 corners[3], picture_color color);
void picture_add_parallelogram(picture *p, dgfem_vec3 a, dgfem_vec3 u, dgfem_vec3 v, picture_color color);

/* Writes the file, frees the picture; 0 and a line on stderr on failure. */
int picture_write(picture *p, const char *path);
void picture_free(picture *p);

#endif
