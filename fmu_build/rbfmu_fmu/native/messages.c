/* Messages to the importer, and the numbers in them. */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

Number number(double x) {
    Number out;
    char *exponent, *point;
    int digits = 0, power;
    if (isnan(x) || isinf(x)) {
        strcpy(out.text, isnan(x) ? "nan" : x < 0.0 ? "-inf" : "inf");
        return out;
    }
    do {
        snprintf(out.text, sizeof out.text, "%.*e", digits, x);
    } while (strtod(out.text, NULL) != x && ++digits < 17);
    exponent = strchr(out.text, 'e');
    power = exponent ? atoi(exponent + 1) : 0;
    if (power >= -4 && power < 16)
        snprintf(out.text, sizeof out.text, "%.*f", digits > power ? digits - power : 1, x);
    point = out.text + strcspn(out.text, "0123456789");
    point += strspn(point, "0123456789");
    if (*point && *point != 'e') *point = '.'; /* whatever the host's locale has there */
    return out;
}

void escape(char *out, const char *text, const char *special) {
    for (; *text; text++) {
        *out++ = *text;
        if (strchr(special, *text)) *out++ = *text;
    }
    *out = 0;
}

static void tell(const Host *host, const char *name, Status status, const char *text) {
    const char *category = status == CALL_DISCARD ? "logStatusDiscard" : "logStatusError";
    if (host->log) host->log(host, name, status, category, text);
}

static void tell_of_call(Instance *m, Status status, const char *call, const char *format, va_list arguments) {
    char text[MESSAGE_SIZE];
    int used = snprintf(text, sizeof text, "%s: ", call);
    vsnprintf(text + used, sizeof text - (size_t)used, format, arguments);
    tell(&m->host, m->name, status, text);
}

Status refuse(Instance *m, const char *call, const char *format, ...) {
    va_list arguments;
    if (!m) return CALL_ERROR;
    va_start(arguments, format);
    tell_of_call(m, CALL_ERROR, call, format, arguments);
    va_end(arguments);
    return CALL_ERROR;
}

Status discard(Instance *m, const char *call, const char *format, ...) {
    va_list arguments;
    if (!m) return CALL_ERROR;
    va_start(arguments, format);
    if (m->logs_discards) tell_of_call(m, CALL_DISCARD, call, format, arguments);
    va_end(arguments);
    return CALL_DISCARD;
}

Instance *refuse_instance(const Host *host, const char *call, const char *name, const char *reason) {
    char text[MESSAGE_SIZE];
    snprintf(text, sizeof text, "%s: %s", call, reason);
    tell(host, name ? name : "", CALL_ERROR, text);
    return NULL;
}

int given(Instance *m, const char *call, size_t n, const void *references, const void *values) {
    int is_given = m && (n == 0 || (references && values));
    if (!is_given) refuse(m, call, "null pointer");
    return is_given;
}

/* Whether discards are among some categories, of which none stands for all; -1 after a message where one is wrong. */
static int has_discards(Instance *m, const char *call, size_t n, const char *const categories[]) {
    static const char *const known[] = CATEGORIES;
    int discards = n == 0;
    if (!given(m, call, n, categories, categories)) return -1;
    for (size_t i = 0; i < n; i++) {
        size_t k = 0;
        if (!categories[i]) return refuse(m, call, "null pointer"), -1;
        while (known[k] && strcmp(categories[i], known[k])) k++;
        if (!known[k]) return refuse(m, call, "there is no category %.64s", categories[i]), -1;
        discards |= !strcmp(known[k], "logStatusDiscard") || !strcmp(known[k], "logAll");
    }
    return discards;
}

Status set_debug_logging(Instance *m, const char *call, int on, size_t n, const char *const categories[]) {
    int discards = has_discards(m, call, n, categories);
    if (discards < 0) return CALL_ERROR;
    m->logs_discards = on && discards;
    return CALL_OK;
}

Status switch_debug_logging(Instance *m, const char *call, int on, size_t n, const char *const categories[]) {
    int discards = has_discards(m, call, n, categories);
    if (discards < 0) return CALL_ERROR;
    if (discards) m->logs_discards = on != 0;
    return CALL_OK;
}
