/* What the readers of formats_read.c and formats_tetrahedra.c share: a file in memory, words and numbers on its lines,
   arrays that grow. */
#ifndef FORMATS_INPUT_H
#define FORMATS_INPUT_H

#include "formats.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FORMATS_MAX_BYTES ((size_t)1 << 30) /* a larger file is refused, and so is an endless one */

/* ---- the input ---- */

typedef struct input {
    const char *path;
    formats_error *error;
    unsigned char *data; /* a zero byte follows the last one */
    size_t size, at;
    int line;      /* of `at`; text formats keep it */
    int is_binary; /* errors name the byte rather than the line */
} input;

/* As formats_fail, with the place. */
FORMATS_PRINTF(2, 3)
static inline int fail_here(const input *in, const char *format, ...) {
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (in->is_binary) formats_fail(in->error, in->path, "byte %zu: %s", in->at, text);
    else formats_fail(in->error, in->path, "line %d: %s", in->line, text);
    return 0;
}

static inline int fail_memory(const input *in) {
    formats_fail(in->error, in->path, "out of memory");
    return 0;
}

/* The whole file in memory. */
static inline int input_open(input *in, const char *path, formats_error *error) {
    size_t capacity = 1 << 16;
    FILE *file;
    memset(in, 0, sizeof *in);
    in->path = path;
    in->error = error;
    in->line = 1;
    file = fopen(path, "rb");
    if (!file) return formats_fail(error, path, "cannot be opened: %s", strerror(errno));
    for (;;) {
        unsigned char *grown = (unsigned char *)realloc(in->data, capacity + 1);
        if (!grown) break;
        in->data = grown;
        in->size += fread(in->data + in->size, 1, capacity - in->size, file);
        in->data[in->size] = 0;
        if (in->size < capacity || capacity > FORMATS_MAX_BYTES) break;
        capacity *= 2;
    }
    if (ferror(file)) formats_fail(error, path, "cannot be read: %s", strerror(errno));
    else if (in->size > FORMATS_MAX_BYTES) formats_fail(error, path, "is larger than %zu bytes", FORMATS_MAX_BYTES);
    else if (!in->data || in->size == capacity) fail_memory(in);
    else if (in->size == 0) formats_fail(error, path, "is empty");
    else {
        fclose(file);
        return 1;
    }
    fclose(file);
    free(in->data);
    in->data = NULL;
    return 0;
}

/* ---- text: words and numbers on lines ---- */

static inline int is_blank(int c) { return c == ' ' || c == '\t' || c == '\r' || c == '\f' || c == '\v'; }

/* Moves behind blanks, but not to another line, except where a backslash continues it. */
static inline void skip_blanks(input *in) {
    for (;;) {
        const unsigned char *s = in->data + in->at;
        if (in->at < in->size && is_blank(*s)) in->at++;
        else if (*s == '\\' && s[1] == '\n') in->at += 2, in->line++;
        else if (*s == '\\' && s[1] == '\r' && s[2] == '\n') in->at += 3, in->line++;
        else return;
    }
}

static inline int at_line_end(input *in) {
    skip_blanks(in);
    return in->at >= in->size || in->data[in->at] == '\n' || in->data[in->at] == '#';
}

static inline void next_line(input *in) {
    while (in->at < in->size && in->data[in->at] != '\n') in->at++;
    if (in->at < in->size) in->at++, in->line++;
}

/* Moves to the next word, over line ends and comments. 0 at the end of the file. */
static inline int find_word(input *in) {
    while (in->at < in->size && at_line_end(in)) next_line(in);
    return in->at < in->size;
}

/* The word here is `word`, ignoring case: moves behind it. */
static inline int take_word(input *in, const char *word) {
    size_t n = strlen(word), i;
    skip_blanks(in);
    if (n > in->size - in->at) return 0;
    for (i = 0; i < n; i++)
        if (tolower(in->data[in->at + i]) != word[i]) return 0;
    if (in->at + n < in->size && !isspace(in->data[in->at + n])) return 0;
    in->at += n;
    return 1;
}

/* Says what is wrong with the word here. */
static inline int fail_word(const input *in, const char *complaint) {
    const unsigned char *word = in->data + in->at;
    int n = 0;
    while (n < 20 && isgraph(word[n])) n++;
    return fail_here(in, "\"%.*s\" %s", n, (const char *)word, complaint);
}

/* A finite number on this line. */
static inline int take_number(input *in, double *out) {
    char *start, *end;
    *out = 0;
    if (at_line_end(in)) return fail_here(in, "a number is missing");
    start = (char *)in->data + in->at;
    *out = strtod(start, &end);
    if (end == start) return fail_word(in, "is not a number");
    if (!isfinite(*out)) return fail_here(in, "a coordinate is NaN or infinite");
    in->at += (size_t)(end - start);
    return 1;
}

/* A whole number on this line. */
static inline int take_integer(input *in, long long lower, long long upper, long long *out) {
    char *start, *end;
    *out = 0;
    if (at_line_end(in)) return fail_here(in, "an index or count is missing");
    start = (char *)in->data + in->at;
    errno = 0;
    *out = strtoll(start, &end, 10);
    if (end == start) return fail_word(in, "is not a whole number");
    if (errno || *out < lower || *out > upper) return fail_word(in, "is out of range");
    in->at += (size_t)(end - start);
    return 1;
}

/* ---- arrays that grow ---- */

/* Room for one more item of `size` bytes. */
static inline int input_room(const input *in, void **data, int count, int *capacity, size_t size) {
    int wanted = *capacity < 256 ? 256 : *capacity > INT_MAX / 6 ? INT_MAX / 3 : 2 * *capacity;
    void *grown;
    if (count < *capacity) return 1;
    if (wanted <= count) return formats_fail(in->error, in->path, "too many vertices or elements");
    grown = realloc(*data, (size_t)wanted * size);
    if (!grown) return fail_memory(in);
    *data = grown;
    *capacity = wanted;
    return 1;
}

static inline int path_ends_with(const char *path, const char *ending) {
    size_t n = strlen(path), m = strlen(ending), i;
    if (n < m) return 0;
    for (i = 0; i < m; i++)
        if (tolower((unsigned char)path[n - m + i]) != ending[i]) return 0;
    return 1;
}

#endif
