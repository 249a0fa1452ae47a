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

Number named(unsigned v) {
    Number out;
    if (v == STATUS_REFERENCE || (HAS_TIME && v == TIME_REFERENCE))
        strcpy(out.text, v == STATUS_REFERENCE ? "status" : "time");
    else if (v > STATUS_REFERENCE && v <= STATUS_REFERENCE + COUNTS)
        snprintf(out.text, sizeof out.text, "%s", COUNT_NAMES[v - STATUS_REFERENCE - 1]);
    else if (v < REFERENCES && elements_of(v).n > 1)
        snprintf(out.text, sizeof out.text, "%s", VARIABLES[*elements_of(v).r].block);
    else if (v < REFERENCES)
        snprintf(out.text, sizeof out.text, "%s", VARIABLES[*elements_of(v).r].name);
    else
        snprintf(out.text, sizeof out.text, "value reference %u", v);
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
    if (status == CALL_WARNING) category = "logStatusWarning";
    if (host->log) host->log(host, name, status, category, text);
}

static void tell_of_call(Instance *m, Status status, const char *call, const char *format, va_list arguments) {
    char text[MESSAGE_SIZE];
    int used = snprintf(text, sizeof text, "%s: ", call);
    vsnprintf(text + used, sizeof text - (size_t)used, format, arguments);
    tell(&m->host, m->name, status, text);
}

Status answer(Instance *m, Status status, const char *call, const char *format, ...) {
    va_list arguments;
    if (!m) return CALL_ERROR;
    va_start(arguments, format);
    tell_of_call(m, status, call, format, arguments);
    va_end(arguments);
    return status;
}

void say_of_tolerance(Instance *m, const char *call, int defined, double tolerance) {
    if (m && defined && tolerance != ACCURACY)
        answer(m, CALL_WARNING, call, "tolerance = %s has no effect: the accuracy is the scene's, %s",
               number(tolerance).text, number(ACCURACY).text);
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

/* Errors and discards are always logged, and there is no other message that could be turned off. */
Status set_debug_logging(Instance *m, const char *call, size_t n, const char *const categories[]) {
    static const char *const known[] = CATEGORIES;
    if (!given(m, call, n, categories, categories)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++) {
        size_t k = 0;
        if (!categories[i]) return refuse(m, call, "null pointer");
        while (known[k] && strcmp(categories[i], known[k])) k++;
        if (!known[k]) return refuse(m, call, "there is no category %.64s", categories[i]);
    }
    return CALL_OK;
}
