/* pack - makes each product header from its umbrella and parts.

       pack [--drafts] SOURCE_DIRECTORY OUTPUT_DIRECTORY

   For each umbrella NAME.in.h in the source directory it writes NAME.h: the umbrella's lines, with every
   #include "FOLDER/PART" of a part replaced by the part under a banner. The umbrella is the only list of parts, and its
   order is the order of dependency: a part may include only parts that stand above it, and since those are in the file
   already, such includes are dropped, as is #pragma once. Two kinds of quoted include are special:
     - a product header that has an umbrella of its own ("dgfem.h" in dgfem_shell.in.h) stays as it is;
     - a part named *_generated.c or *_generated.h is not listed in the umbrella but inserted where its user includes it;
     - a part without #pragma once is not listed either, and is inserted at each of its includes: code that is compiled
       several times with different macros.
   The umbrella's line that is just a comment `@contents` becomes a table of contents: each part's name and the first
   sentence of its first comment.

   It fails, and writes nothing, on: a missing part; a part listed twice; a part in a folder that no umbrella lists
   (--drafts: a warning); an include of a part further down; CR, tabs, trailing blanks, bytes beyond ASCII; a comment or
   #if left open at the end of a file. The result depends on nothing but the sources. A file that would not change is
   left alone; others are written beside the target and renamed. */
#include <ctype.h>
#include <dirent.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MAX_PARTS = 256, MAX_NAME = 256, MAX_PATH = 1024, MAX_IF_DEPTH = 64, WIDTH = 120 };

static void fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "pack: ");
    vfprintf(stderr, format, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
    exit(1);
}

/* "folder" + "/" + "name" */
static void join(char path[MAX_PATH], const char *folder, const char *name) {
    size_t n = strlen(folder), m = strlen(name);
    if (n + 1 + m >= MAX_PATH) fail("%s/%s: path too long", folder, name);
    memcpy(path, folder, n);
    path[n] = '/';
    memcpy(path + n + 1, name, m + 1);
}

/* ---- growing text ---- */

typedef struct text {
    char *data;
    size_t size, capacity;
} text;

static void text_add(text *t, const char *data, size_t size) {
    if (t->size + size + 1 > t->capacity) {
        t->capacity = 2 * (t->size + size) + 4096;
        t->data = (char *)realloc(t->data, t->capacity);
        if (!t->data) fail("out of memory");
    }
    memcpy(t->data + t->size, data, size);
    t->size += size;
    t->data[t->size] = '\0';
}

static void text_add_string(text *t, const char *string) { text_add(t, string, strlen(string)); }

static int text_ends_with_blank_line(const text *t) {
    return t->size == 0 || (t->size >= 2 && memcmp(t->data + t->size - 2, "\n\n", 2) == 0);
}

/* ---- files ---- */

/* The whole file, or 0 when it cannot be opened. */
static int file_read(const char *path, text *out) {
    char buffer[65536];
    size_t count;
    FILE *file = fopen(path, "rb");
    if (!file) return 0;
    out->size = 0;
    text_add(out, "", 0);
    while ((count = fread(buffer, 1, sizeof buffer, file)) > 0) text_add(out, buffer, count);
    if (ferror(file)) fail("%s: cannot be read", path);
    fclose(file);
    return 1;
}

static void file_write_if_changed(const char *path, const text *contents) {
    char suffix[32], temporary[MAX_PATH + 32];
    text old = {0};
    FILE *file;
    int same = file_read(path, &old) && old.size == contents->size && memcmp(old.data, contents->data, old.size) == 0;
    free(old.data);
    if (same) return;
    snprintf(suffix, sizeof suffix, ".%ld.tmp", (long)getpid());
    strcpy(temporary, path);
    strcat(temporary, suffix);
    file = fopen(temporary, "wb");
    if (!file) fail("%s: cannot be written", temporary);
    if (fwrite(contents->data, 1, contents->size, file) != contents->size || fclose(file) != 0) {
        remove(temporary);
        fail("%s: cannot be written", temporary);
    }
    if (rename(temporary, path) != 0) {
        remove(temporary);
        fail("%s: cannot be replaced", path);
    }
    printf("packed %s\n", path);
}

/* ---- reading C line by line ---- */

/* A walk over the lines of one file: knows where comments are, checks the bytes and the nesting of #if. */
typedef struct reader {
    const char *name; /* for messages, relative to the source directory */
    const text *source;
    size_t next; /* offset of the next line */
    int line_number;
    const char *line; /* the current line, without line feed */
    size_t length;
    int in_comment, continued; /* at the end of the current line */
    char directive[16];        /* "include", "if", ... or "" */
    const char *rest;          /* behind the directive, up to line + length */
    int if_depth;
    int if_line[MAX_IF_DEPTH];
} reader;

static reader reader_make(const char *name, const text *source) {
    reader r;
    memset(&r, 0, sizeof r);
    r.name = name;
    r.source = source;
    return r;
}

static void reader_check_bytes(const reader *r) {
    size_t i;
    for (i = 0; i < r->length; i++) {
        unsigned char c = (unsigned char)r->line[i];
        if (c == '\r') fail("%s:%d: carriage return", r->name, r->line_number);
        if (c == '\t') fail("%s:%d: tab", r->name, r->line_number);
        if (c < 32 || c > 126) fail("%s:%d: byte 0x%02x is not printable ASCII", r->name, r->line_number, c);
    }
    if (r->length && r->line[r->length - 1] == ' ') fail("%s:%d: trailing blank", r->name, r->line_number);
}

/* Follows comments and literals through the line. */
static void reader_scan(reader *r) {
    size_t i = 0, n = r->length;
    const char *s = r->line;
    while (i < n) {
        if (r->in_comment) {
            if (s[i] == '*' && i + 1 < n && s[i + 1] == '/') r->in_comment = 0, i++;
        } else if (s[i] == '/' && i + 1 < n && s[i + 1] == '*') {
            r->in_comment = 1, i++;
        } else if (s[i] == '/' && i + 1 < n && s[i + 1] == '/') {
            break;
        } else if (s[i] == '"' || s[i] == '\'') {
            char quote = s[i];
            for (i++; i < n && s[i] != quote; i++)
                if (s[i] == '\\') i++;
        }
        i++;
    }
    r->continued = n > 0 && s[n - 1] == '\\';
}

static void reader_find_directive(reader *r) {
    const char *s = r->line, *end = r->line + r->length;
    size_t n = 0;
    r->directive[0] = '\0';
    while (s < end && *s == ' ') s++;
    if (s == end || *s != '#') return;
    for (s++; s < end && *s == ' ';) s++;
    while (s < end && isalpha((unsigned char)*s) && n + 1 < sizeof r->directive) r->directive[n++] = *s++;
    r->directive[n] = '\0';
    while (s < end && *s == ' ') s++;
    r->rest = s;
}

static void reader_track_if(reader *r) {
    const char *d = r->directive;
    if (strcmp(d, "if") == 0 || strcmp(d, "ifdef") == 0 || strcmp(d, "ifndef") == 0) {
        if (r->if_depth == MAX_IF_DEPTH) fail("%s:%d: too many nested #if", r->name, r->line_number);
        r->if_line[r->if_depth++] = r->line_number;
    } else if (strcmp(d, "endif") == 0) {
        if (r->if_depth == 0) fail("%s:%d: #endif without #if", r->name, r->line_number);
        r->if_depth--;
    } else if (strcmp(d, "else") == 0 || strcmp(d, "elif") == 0) {
        if (r->if_depth == 0) fail("%s:%d: #%s without #if", r->name, r->line_number, d);
    }
}

/* Advances to the next line; 0 at the end of the file. */
static int reader_next(reader *r) {
    const char *data = r->source->data, *feed;
    int was_plain = !r->in_comment && !r->continued;
    if (r->next == r->source->size) {
        if (r->in_comment) fail("%s: a comment is left open", r->name);
        if (r->if_depth) fail("%s:%d: #if without #endif", r->name, r->if_line[r->if_depth - 1]);
        return 0;
    }
    r->line_number++;
    r->line = data + r->next;
    feed = (const char *)memchr(r->line, '\n', r->source->size - r->next);
    if (!feed) fail("%s:%d: no line feed at the end of the file", r->name, r->line_number);
    r->length = (size_t)(feed - r->line);
    r->next += r->length + 1;
    reader_check_bytes(r);
    reader_scan(r);
    r->directive[0] = '\0';
    if (was_plain) {
        reader_find_directive(r);
        reader_track_if(r);
    }
    return 1;
}

/* The name in a quoted include, 1; 0 for any other line. */
static int reader_quoted_include(const reader *r, char name[MAX_NAME]) {
    const char *end = r->line + r->length, *close;
    size_t n;
    if (strcmp(r->directive, "include") != 0 || r->rest == end || *r->rest != '"') return 0;
    close = (const char *)memchr(r->rest + 1, '"', (size_t)(end - r->rest - 1));
    if (!close) fail("%s:%d: #include without closing quote", r->name, r->line_number);
    n = (size_t)(close - r->rest - 1);
    if (n == 0 || n >= MAX_NAME) fail("%s:%d: bad name in #include", r->name, r->line_number);
    memcpy(name, r->rest + 1, n);
    name[n] = '\0';
    return 1;
}

static int reader_is_pragma_once(const reader *r) {
    size_t n = r->rest ? (size_t)(r->line + r->length - r->rest) : 0;
    return strcmp(r->directive, "pragma") == 0 && n == 4 && memcmp(r->rest, "once", 4) == 0;
}

/* ---- parts ---- */

typedef struct part {
    char name[MAX_NAME]; /* relative to the source directory: "dgfem/base.c" */
    text source;
    int inserted; /* generated parts: already in the file */
} part;

typedef struct packer {
    const char *source_directory;
    char umbrella[MAX_NAME]; /* "dgfem.in.h" */
    part *parts;             /* the umbrella's, in order; generated ones behind them */
    int listed, count;
    text out;
} packer;

static int ends_with(const char *name, const char *ending) {
    size_t n = strlen(name), m = strlen(ending);
    return n >= m && strcmp(name + n - m, ending) == 0;
}

static int is_generated(const char *name) {
    return ends_with(name, "_generated.c") || ends_with(name, "_generated.h");
}

static const char *base_name(const char *name) {
    const char *slash = strrchr(name, '/');
    return slash ? slash + 1 : name;
}

/* "dgfem.h" is a product when dgfem.in.h exists. */
static int is_product(const packer *p, const char *name) {
    char umbrella[MAX_NAME + 8], path[MAX_PATH];
    if (strchr(name, '/') || !ends_with(name, ".h")) return 0;
    snprintf(umbrella, sizeof umbrella, "%.*s.in.h", (int)(strlen(name) - 2), name);
    join(path, p->source_directory, umbrella);
    return access(path, R_OK) == 0;
}

static int part_find(const packer *p, const char *name) {
    int i;
    for (i = 0; i < p->count; i++)
        if (strcmp(p->parts[i].name, name) == 0) return i;
    return -1;
}

static int part_add(packer *p, const char *name, const reader *from) {
    char path[MAX_PATH];
    part *added = &p->parts[p->count];
    if (p->count == MAX_PARTS) fail("%s:%d: too many parts", from->name, from->line_number);
    if (part_find(p, name) >= 0) fail("%s:%d: \"%s\" is listed twice", from->name, from->line_number, name);
    memset(added, 0, sizeof *added);
    snprintf(added->name, sizeof added->name, "%s", name);
    join(path, p->source_directory, name);
    if (!file_read(path, &added->source)) fail("%s:%d: part \"%s\" is missing", from->name, from->line_number, name);
    return p->count++;
}

/* A part without #pragma once is inserted wherever it is included. */
static int is_repeated(const packer *p, const char *name) {
    char path[MAX_PATH];
    text source = {0};
    reader r = reader_make(name, &source);
    int repeated;
    join(path, p->source_directory, name);
    repeated = file_read(path, &source);
    while (repeated && reader_next(&r))
        if (reader_is_pragma_once(&r)) repeated = 0;
    free(source.data);
    return repeated;
}

/* Reads every part that the umbrella lists. */
static void collect_parts(packer *p, const text *umbrella) {
    reader r = reader_make(p->umbrella, umbrella);
    char name[MAX_NAME];
    while (reader_next(&r))
        if (reader_quoted_include(&r, name) && !is_product(p, name)) part_add(p, name, &r);
    p->listed = p->count;
}

/* ---- table of contents ---- */

/* The first sentence of the part's first comment, on one line. */
static void describe(const part *of, char *out, size_t size) {
    const char *s = strstr(of->source.data, "/*");
    size_t n = 0;
    out[0] = '\0';
    if (!s) fail("%s: no comment that says what it is", of->name);
    for (s += 2; *s && n + 2 < size; s++) {
        char c = *s == '\n' ? ' ' : *s;
        if (s[0] == '*' && s[1] == '/') break;
        if (c == ' ' && (n == 0 || out[n - 1] == ' ')) continue;
        out[n++] = c;
        if (c == '.' && (s[1] == ' ' || s[1] == '\n')) break;
    }
    while (n > 0 && out[n - 1] == ' ') n--;
    out[n] = '\0';
}

static void add_contents(packer *p) {
    enum { INDENT = 22 };
    int i;
    text_add_string(&p->out, "/* Contents, in the order of dependency; search for \"== name\".\n\n");
    for (i = 0; i < p->listed; i++) {
        char description[1024], *word, row[MAX_NAME + 64];
        size_t column = INDENT;
        describe(&p->parts[i], description, sizeof description);
        snprintf(row, sizeof row, "   %-*s", INDENT - 4, base_name(p->parts[i].name));
        text_add_string(&p->out, row);
        for (word = strtok(description, " "); word; word = strtok(NULL, " ")) {
            if (column + strlen(word) + 1 > WIDTH) {
                snprintf(row, sizeof row, "\n%*s", INDENT - 1, "");
                text_add_string(&p->out, row);
                column = INDENT;
            }
            text_add_string(&p->out, " ");
            text_add_string(&p->out, word);
            column += strlen(word) + 1;
        }
        text_add_string(&p->out, i + 1 < p->listed ? "\n" : " */\n");
    }
}

/* ---- packing ---- */

static void add_banner(packer *p, const char *name) {
    size_t start;
    if (!text_ends_with_blank_line(&p->out)) text_add_string(&p->out, "\n");
    start = p->out.size;
    text_add_string(&p->out, "/* ==== ");
    text_add_string(&p->out, name);
    text_add_string(&p->out, " ");
    while (p->out.size - start < WIDTH - 3) text_add_string(&p->out, "=");
    text_add_string(&p->out, " */\n\n");
}

static void add_line(packer *p, const reader *r) {
    text_add(&p->out, r->line, r->length);
    text_add_string(&p->out, "\n");
}

/* Copies the lines of one part. `user` is the listed part that it belongs to: itself or, for a part that is not listed,
   the includer. Such a part (nested = 1) includes no other of its kind, so this calls itself once at most. */
static void add_part(packer *p, int index, int user, int nested) {
    reader r = reader_make(p->parts[index].name, &p->parts[index].source);
    char folder[MAX_NAME], name[MAX_NAME], full[2 * MAX_NAME];
    int blank = 1; /* the last line written was blank: at the top and around dropped lines one blank line is enough */
    snprintf(folder, sizeof folder, "%s", p->parts[index].name);
    folder[base_name(folder) - folder] = '\0';
    while (reader_next(&r)) {
        if (reader_is_pragma_once(&r)) continue;
        if (reader_quoted_include(&r, name)) {
            int found;
            snprintf(full, sizeof full, "%s%s", folder, name);
            found = part_find(p, full);
            if (found >= 0 && found < p->listed) {
                if (found >= user)
                    fail("%s:%d: \"%s\" does not stand above it in %s", r.name, r.line_number, full, p->umbrella);
            } else if (is_generated(full) && !nested) {
                if (found >= 0) fail("%s:%d: \"%s\" is included twice", r.name, r.line_number, full);
                add_part(p, part_add(p, full, &r), user, 1);
                text_add_string(&p->out, "\n");
                blank = 1;
            } else if (!nested && is_repeated(p, full)) {
                add_part(p, found >= 0 ? found : part_add(p, full, &r), user, 1);
                text_add_string(&p->out, "\n");
                blank = 1;
            } else if (!is_product(p, name)) {
                fail("%s:%d: \"%s\" is not listed in %s", r.name, r.line_number, full, p->umbrella);
            }
            continue;
        }
        if (r.length == 0 && blank) continue;
        blank = r.length == 0;
        add_line(p, &r);
    }
    while (p->out.size >= 2 && text_ends_with_blank_line(&p->out)) p->out.data[--p->out.size] = '\0';
}

static void pack(packer *p, const text *umbrella) {
    reader r = reader_make(p->umbrella, umbrella);
    char name[MAX_NAME];
    int next = 0, after_part = 0;
    while (reader_next(&r)) {
        if (reader_quoted_include(&r, name) && !is_product(p, name)) {
            add_banner(p, base_name(name));
            add_part(p, next, next, 0);
            next++;
            after_part = 1;
            continue;
        }
        if (after_part && !text_ends_with_blank_line(&p->out) && r.length) text_add_string(&p->out, "\n");
        after_part = 0;
        if (r.length == strlen("/* @contents */") && memcmp(r.line, "/* @contents */", r.length) == 0) add_contents(p);
        else add_line(p, &r);
    }
}

/* ---- parts that nobody lists ---- */

typedef struct name_list {
    char (*names)[MAX_NAME];
    int count, capacity;
} name_list;

static void name_list_add(name_list *list, const char *name) {
    if (list->count == list->capacity) {
        list->capacity = 2 * list->capacity + 64;
        list->names = (char(*)[MAX_NAME])realloc(list->names, (size_t)list->capacity * MAX_NAME);
        if (!list->names) fail("out of memory");
    }
    snprintf(list->names[list->count++], MAX_NAME, "%s", name);
}

static int compare_names(const void *a, const void *b) { return strcmp((const char *)a, (const char *)b); }

/* Entries of a directory, sorted; empty when it is none. */
static name_list list_directory(const char *path) {
    name_list list = {0};
    DIR *directory = opendir(path);
    struct dirent *entry;
    if (!directory) return list;
    while ((entry = readdir(directory)) != NULL)
        if (entry->d_name[0] != '.') name_list_add(&list, entry->d_name);
    closedir(directory);
    if (list.count) qsort(list.names, (size_t)list.count, MAX_NAME, compare_names);
    return list;
}

static int name_list_has(const name_list *list, const char *name) {
    int i;
    for (i = 0; i < list->count; i++)
        if (strcmp(list->names[i], name) == 0) return 1;
    return 0;
}

static void check_all_listed(const char *source_directory, const name_list *used, int drafts) {
    name_list folders = list_directory(source_directory);
    int i, j, missing = 0;
    for (i = 0; i < folders.count; i++) {
        char path[MAX_PATH];
        name_list files;
        if (strcmp(folders.names[i], "gen") == 0) continue;
        join(path, source_directory, folders.names[i]);
        files = list_directory(path);
        for (j = 0; j < files.count; j++) {
            char name[2 * MAX_NAME];
            snprintf(name, sizeof name, "%s/%s", folders.names[i], files.names[j]);
            if ((!ends_with(name, ".c") && !ends_with(name, ".h")) || name_list_has(used, name)) continue;
            fprintf(stderr, "pack: %s%s: no umbrella lists it\n", drafts ? "warning: " : "", name);
            missing++;
        }
        free(files.names);
    }
    free(folders.names);
    if (missing && !drafts) fail("%d part(s) that no umbrella lists (`make headers DRAFTS=1` tolerates them)", missing);
}

int main(int argc, char **argv) {
    int drafts = argc > 1 && strcmp(argv[1], "--drafts") == 0, i, j, umbrellas = 0;
    name_list entries, used = {0};
    packer *packers;
    if (argc != 3 + drafts) fail("usage: pack [--drafts] SOURCE_DIRECTORY OUTPUT_DIRECTORY");
    entries = list_directory(argv[1 + drafts]);
    packers = (packer *)calloc((size_t)entries.count + 1, sizeof *packers);
    if (!packers) fail("out of memory");

    /* Pack all umbrellas in memory, so that nothing is written when one of them is wrong. */
    for (i = 0; i < entries.count; i++) {
        packer *p = &packers[umbrellas];
        text umbrella = {0};
        char path[MAX_PATH];
        if (!ends_with(entries.names[i], ".in.h")) continue;
        p->source_directory = argv[1 + drafts];
        p->parts = (part *)calloc(MAX_PARTS, sizeof *p->parts);
        if (!p->parts) fail("out of memory");
        snprintf(p->umbrella, sizeof p->umbrella, "%s", entries.names[i]);
        join(path, p->source_directory, p->umbrella);
        if (!file_read(path, &umbrella)) fail("%s: cannot be read", path);
        collect_parts(p, &umbrella);
        pack(p, &umbrella);
        for (j = 0; j < p->count; j++) name_list_add(&used, p->parts[j].name);
        free(umbrella.data);
        umbrellas++;
    }
    if (!umbrellas) fail("%s: no umbrella NAME.in.h", argv[1 + drafts]);
    check_all_listed(argv[1 + drafts], &used, drafts);

    for (i = 0; i < umbrellas; i++) {
        char path[MAX_PATH], product[MAX_NAME];
        int n = (int)(strlen(packers[i].umbrella) - strlen(".in.h"));
        snprintf(product, sizeof product, "%.*s.h", n, packers[i].umbrella);
        join(path, argv[2 + drafts], product);
        file_write_if_changed(path, &packers[i].out);
        for (j = 0; j < packers[i].count; j++) free(packers[i].parts[j].source.data);
        free(packers[i].parts);
        free(packers[i].out.data);
    }
    free(packers);
    free(entries.names);
    free(used.names);
    return 0;
}
