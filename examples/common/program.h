/* What the examples' main functions share: command line options, a clock, log lines on stderr, a progress bar.

       program p = program_begin(argc, argv, "slice MODEL [--cells N] [--sliver T] [--obj F]");
       int cells = program_int(&p, "--cells", 10, 1, 1000);
       const char *obj = program_text(&p, "--obj", NULL);
       const char *model = program_argument(&p);            after the options, whose values are not arguments
       program_end(&p);                                     exits with a message when anything was wrong

   All options are `--name value`, except flags. The last of several equal options counts. */
#ifndef PROGRAM_H
#define PROGRAM_H

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "dgfem.h"

/* ---- options ---- */

enum { PROGRAM_MAX_ARGUMENTS = 256 };

typedef struct program {
    int argc;
    char **argv;
    const char *usage;
    char used[PROGRAM_MAX_ARGUMENTS]; /* arguments that an option or program_argument has taken */
    char complaint[256];              /* the first thing that was wrong, or "" */
} program;

static inline program program_begin(int argc, char **argv, const char *usage) {
    program p;
    memset(&p, 0, sizeof p);
    p.argc = argc;
    p.argv = argv;
    p.usage = usage;
    if (argc > PROGRAM_MAX_ARGUMENTS) {
        snprintf(p.complaint, sizeof p.complaint, "too many arguments");
        p.argc = PROGRAM_MAX_ARGUMENTS;
    }
    return p;
}

static inline void program_complain(program *p, const char *name, const char *complaint) {
    if (!p->complaint[0]) snprintf(p->complaint, sizeof p->complaint, "%.60s %.180s", name, complaint);
}

/* The value of the last `name value`, or `otherwise`. */
static inline const char *program_text(program *p, const char *name, const char *otherwise) {
    int i;
    for (i = 1; i < p->argc; i++) {
        if (p->used[i] || strcmp(p->argv[i], name) != 0) continue;
        p->used[i] = 1;
        if (i + 1 == p->argc) {
            program_complain(p, name, "needs a value");
            break;
        }
        otherwise = p->argv[++i];
        p->used[i] = 1;
    }
    return otherwise;
}

/* 1 where the flag is given. */
static inline int program_flag(program *p, const char *name) {
    int i, found = 0;
    for (i = 1; i < p->argc; i++)
        if (!p->used[i] && strcmp(p->argv[i], name) == 0) p->used[i] = 1, found = 1;
    return found;
}

/* A finite number. Its range is the library's to judge. */
static inline double program_real(program *p, const char *name, double otherwise) {
    const char *text = program_text(p, name, NULL);
    char *end;
    double value;
    if (!text) return otherwise;
    value = strtod(text, &end);
    if (end == text || *end || !isfinite(value)) program_complain(p, name, "needs a number");
    return value;
}

static inline int program_int(program *p, const char *name, int otherwise, int lower, int upper) {
    const char *text = program_text(p, name, NULL);
    char *end, complaint[80];
    long value;
    if (!text) return otherwise;
    errno = 0;
    value = strtol(text, &end, 10);
    if (end != text && !*end && !errno && value >= lower && value <= upper) return (int)value;
    snprintf(complaint, sizeof complaint, "needs a whole number from %d to %d", lower, upper);
    program_complain(p, name, complaint);
    return otherwise;
}

/* Which of the words in "first|second|third" is given: 0, 1, 2. */
static inline int program_choice(program *p, const char *name, const char *words, int otherwise) {
    const char *text = program_text(p, name, NULL), *word = words;
    char complaint[120];
    int i;
    if (!text) return otherwise;
    for (i = 0; word; i++) {
        const char *bar = strchr(word, '|');
        size_t n = bar ? (size_t)(bar - word) : strlen(word);
        if (strlen(text) == n && memcmp(text, word, n) == 0) return i;
        word = bar ? bar + 1 : NULL;
    }
    snprintf(complaint, sizeof complaint, "needs one of %s", words);
    program_complain(p, name, complaint);
    return otherwise;
}

/* The next argument that is no option, or NULL. */
static inline const char *program_argument(program *p) {
    int i;
    for (i = 1; i < p->argc; i++)
        if (!p->used[i] && strncmp(p->argv[i], "--", 2) != 0) {
            p->used[i] = 1;
            return p->argv[i];
        }
    return NULL;
}

/* Ends the program where --help is given (exit 0) or an argument is wrong or unknown (exit 2). */
static inline void program_end(program *p) {
    int i;
    if (program_flag(p, "--help")) {
        printf("usage: %s\n", p->usage);
        exit(0);
    }
    for (i = 1; i < p->argc; i++)
        if (!p->used[i]) program_complain(p, p->argv[i], "is not understood");
    if (!p->complaint[0]) return;
    fprintf(stderr, "%s\nusage: %s\n", p->complaint, p->usage);
    exit(2);
}

/* ---- time and log ---- */

/* Seconds since some fixed time. */
static inline double program_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static inline double program_clock(void *user) {
    (void)user;
    return program_seconds();
}

static inline void program_log(void *user, dgfem_log_level level, const char *text) {
    (void)user;
    (void)level;
    fprintf(stderr, "%s\n", text);
}

/* libc's allocator, one thread, the log on stderr, a clock. */
static inline dgfem_hooks program_hooks(void) {
    dgfem_hooks hooks;
    memset(&hooks, 0, sizeof hooks);
    hooks.log = program_log;
    hooks.clock = program_clock;
    return hooks;
}

/* ---- progress ---- */

/* A bar on stderr where that is a terminal, nothing elsewhere. Zero it before use. */
typedef struct program_progress {
    double shown_at;
    int is_shown;
} program_progress;

/* `text` may be NULL. Drawn ten times a second at most. */
static inline void program_show_progress(program_progress *progress, int done, int total, const char *text) {
    enum { WIDTH = 40 };
    double now = program_seconds();
    int filled = total > 0 ? (int)((double)WIDTH * (double)done / (double)total) : 0, i;
    if (!isatty(STDERR_FILENO) || (progress->is_shown && done < total && now - progress->shown_at < 0.1)) return;
    fputs("\r[", stderr);
    for (i = 0; i < WIDTH; i++) fputc(i < filled ? '=' : i == filled ? '>' : ' ', stderr);
    fprintf(stderr, "] %3d %%  %s\033[K", total > 0 ? (int)(100.0 * (double)done / (double)total) : 0,
            text ? text : "");
    fflush(stderr);
    progress->is_shown = 1;
    progress->shown_at = now;
}

/* Takes the bar away. */
static inline void program_end_progress(program_progress *progress) {
    if (progress->is_shown) fputs("\r\033[K", stderr);
    progress->is_shown = 0;
}

#endif
