/* The compiled path of channels.py, regions.py, features.py, trees.py and lines.py: the same numbers, found faster.

   Only what numpy and OpenCV cannot do without a loop over pixels, components or regions in Python. Names, shapes and
   units are those of the Python modules; native.py calls, and sees to types and shapes. No global state; scratch memory
   is taken and given back in each call. Functions that can run out of memory return -1 then. What is larger than they
   have room for, or would make them look beyond what they are given, they return REFUSED for; numpy then does it. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define INTERFACE 1 /* of native.py; another number when what is passed changes */
#define REFUSED -2
#define RANGE 1024
#define SUMS 8
#define LARGEST 4096 /* rows or columns, or pixels of a band */

typedef struct {
    int32_t channel, level, since, left, top, width, height, area, sum_u, sum_v, color[3], first, past, part;
    int32_t parent[6], twice[6]; /* level, left, top, width, height, area */
} Region;

static int clip(int value, int low, int high) { return value < low ? low : value > high ? high : value; }

int interface(void) { return INTERFACE; }

/* Whether all sums over so many pixels stay below 2^31: each adds its row, its column or the strength of its edges, and
   these are less than 2^12. */
static int is_small(int rows, int width) { return rows <= LARGEST && width <= LARGEST && rows * width <= 1 << 19; }

/* ---------------------------------------------------------------- channels */

typedef int32_t four __attribute__((vector_size(16), aligned(4)));

/* picture: (rows, width, 3). light: (256), levels of bright | levels of dark << 8, by the green value. heights:
   (7, rows, width), channels 0, 1, 2, 5, 6 are written. sums: (rows + 1, width + 1, SUMS). */
int channels(const uint8_t *picture, int rows, int width, const int16_t *logarithms, const int16_t *less,
             const uint8_t *steps, const uint16_t *light, uint8_t *heights, int32_t *sums)
{
    if (!is_small(rows, width)) return REFUSED;
    const size_t plane = (size_t)rows * width;
    const int wide = width + 2;
    int16_t *bright = malloc((size_t)(rows + 2) * wide * sizeof *bright);
    int16_t *colors = malloc(2 * plane * sizeof *colors), *lines = malloc(6 * (size_t)wide * sizeof *lines);
    if (!colors || !bright || !lines) {
        free(colors), free(bright), free(lines);
        return -1;
    }
    const int16_t *log_b = logarithms, *log_g = logarithms + 256, *log_r = logarithms + 512;
    const int16_t *less_of = less + RANGE;
    const uint8_t *yellow = steps + RANGE, *red = yellow + 2 * RANGE, *blueless = red + 2 * RANGE;
    for (int v = 0; v < rows; v++) {
        int16_t *line = bright + (size_t)(v + 1) * wide + 1;
        const uint8_t *pixel = picture + 3 * (size_t)v * width;
        uint8_t *height = heights + (size_t)v * width;
        int16_t *color = colors + 2 * (size_t)v * width;
        for (int u = 0; u < width; u++, pixel += 3) {
            const int g = log_g[pixel[1]], r = log_r[pixel[2]], of_light = light[pixel[1]];
            const int both = (g + r) >> 1, green = g - r, blue = log_b[pixel[0]] - both;
            const int value = both + less_of[blue];
            line[u] = both;
            color[2 * u] = green;
            color[2 * u + 1] = blue;
            height[u] = value < 1 - RANGE ? 0 : yellow[value];
            height[plane + u] = red[green];
            height[2 * plane + u] = blueless[blue];
            height[5 * plane + u] = of_light & 255;
            height[6 * plane + u] = of_light >> 8;
        }
        line[-1] = line[0];
        line[width] = line[width - 1];
    }
    memcpy(bright, bright + wide, wide * sizeof *bright);
    memcpy(bright + (size_t)(rows + 1) * wide, bright + (size_t)rows * wide, wide * sizeof *bright);
    memset(sums, 0, (size_t)(width + 1) * SUMS * sizeof *sums);
    int16_t *smooth = lines, *down = lines + wide;
    int16_t *edge[4] = {lines + 2 * wide, lines + 3 * wide, lines + 4 * wide, lines + 5 * wide};
    for (int v = 0; v < rows; v++) {
        const int16_t *line = bright + (size_t)(v + 1) * wide, *above = line - wide, *below = line + wide;
        for (int u = 0; u < wide; u++) {
            smooth[u] = above[u] + 2 * line[u] + below[u];
            down[u] = below[u] - above[u];
        }
        for (int u = 0; u < width; u++) {
            const int16_t x = smooth[u + 2] - smooth[u], y = down[u] + 2 * down[u + 1] + down[u + 2];
            const int16_t ax = x < 0 ? -x : x, ay = y < 0 ? -y : y, most = ax > ay ? ax : ay, least = ax > ay ? ay : ax;
            const int16_t straight = most - least, slanting = least + (least >> 2) + (least >> 3) + (least >> 5);
            const int16_t flat = -(ax >= ay), rising = -((x > 0) == (y > 0));
            edge[0][u] = straight & flat;
            edge[1][u] = slanting & rising;
            edge[2][u] = straight & ~flat;
            edge[3][u] = slanting & ~rising;
        }
        const int16_t *color = colors + 2 * (size_t)v * width;
        int32_t *cell = sums + (size_t)(v + 1) * (width + 1) * SUMS;
        const int32_t *over = cell - (size_t)(width + 1) * SUMS;
        four one = {0}, two = {0};
        memset(cell, 0, SUMS * sizeof *cell);
        for (int u = 0; u < width; u++) {
            cell += SUMS, over += SUMS;
            one += (four){line[u + 1], color[2 * u], color[2 * u + 1], edge[0][u]};
            two += (four){edge[1][u], edge[2][u], edge[3][u], 0};
            *(four *)cell = *(const four *)over + one;
            *(four *)(cell + 4) = *(const four *)(over + 4) + two;
        }
    }
    free(colors), free(bright), free(lines);
    return 0;
}

/* Minimum or maximum of each value and the following ones, so many in all. */
static void slid_across(uint8_t *line, int length, int pixels, int least)
{
    for (int done = 1; done < pixels;) {
        const int step = 2 * done <= pixels ? done : pixels - done;
        const uint8_t *other = line + step;
        if (least) {
#pragma GCC ivdep
            for (int u = 0; u < length - step; u++) line[u] = line[u] < other[u] ? line[u] : other[u];
        } else {
#pragma GCC ivdep
            for (int u = 0; u < length - step; u++) line[u] = line[u] > other[u] ? line[u] : other[u];
        }
        done += step;
    }
}

static void slid_pair(uint8_t *restrict line, const uint8_t *restrict other, int length, int least)
{
    if (least)
        for (int u = 0; u < length; u++) line[u] = line[u] < other[u] ? line[u] : other[u];
    else
        for (int u = 0; u < length; u++) line[u] = line[u] > other[u] ? line[u] : other[u];
}

static void slid_down(uint8_t *data, int rows, int width, int pixels, int least)
{
    for (int done = 1; done < pixels;) {
        const int step = 2 * done <= pixels ? done : pixels - done;
        for (int v = 0; v < rows - step; v++) slid_pair(data + (size_t)v * width, data + (size_t)(v + step) * width, width, least);
        done += step;
    }
}

/* Grey opening by a square, or closing by a column, of so many pixels in each band of rows; what is outside does not
   count. bands: (count, 3) first, past, pixels, an odd number. */
int morphed(const uint8_t *height, int rows, int width, const int32_t *bands, int count, int closing, uint8_t *result)
{
    int largest = 1;
    for (int i = 0; i < count; i++) {
        const int first = bands[3 * i], past = bands[3 * i + 1], pixels = bands[3 * i + 2];
        if (first < 0 || past < first || past > rows || pixels < 1 || pixels > LARGEST) return REFUSED;
        if (pixels > largest) largest = pixels;
    }
    const size_t size = (size_t)(rows + 2 * largest) * (width + 2 * largest);
    uint8_t *one = malloc(2 * size);
    if (!one) return -1;
    uint8_t *two = one + size;
    for (int i = 0; i < count; i++) {
        const int first = bands[3 * i], past = bands[3 * i + 1], pixels = bands[3 * i + 2], half = pixels / 2;
        if (pixels == 1) {
            memcpy(result + (size_t)first * width, height + (size_t)first * width, (size_t)(past - first) * width);
            continue;
        }
        const int aside = closing ? 0 : half, wide = width + 2 * aside;
        const int begin = first - 2 * half, tall = past - first + 4 * half; /* rows that have a say */
        for (int v = 0; v < tall; v++) {
            uint8_t *line = one + (size_t)v * wide;
            const int from = begin + v;
            memset(line, closing ? 0 : 255, wide);
            if (from >= 0 && from < rows) memcpy(line + aside, height + (size_t)from * width, width);
            if (!closing) slid_across(line, wide, pixels, 1);
        }
        slid_down(one, tall, wide, pixels, !closing);
        for (int v = 0; v < tall - 2 * half; v++) { /* row begin + half + v */
            uint8_t *line = two + (size_t)v * wide;
            const int from = begin + half + v, shown = from >= 0 && from < rows;
            memset(line, closing ? 255 : 0, wide);
            if (shown || closing) memcpy(line + aside, one + (size_t)v * wide, width);
            if (!closing) slid_across(line, wide, pixels, 0);
        }
        slid_down(two, tall - 2 * half, wide, pixels, closing);
        for (int v = first; v < past; v++) memcpy(result + (size_t)v * width, two + (size_t)(v - first) * wide, width);
    }
    free(one);
    return 0;
}

/* ----------------------------------------------------------------- regions */

typedef struct {
    int16_t row, begin, end, height;
    int32_t node, next; /* that it is in; of the runs that are in no node yet */
} Run;

typedef struct {
    int32_t up;         /* the run that this one is joined to; a root is joined to itself */
    int32_t level, area;
    int32_t free, free_last; /* runs that are in no node yet */
    int32_t kids, kids_last; /* nodes without a parent yet */
} Set;

typedef struct {
    int32_t level, area, left, top, right, bottom, sum_u, sum_v, color[3];
    int32_t parent, next, part, size, first;
} Node;

typedef struct {
    Run *runs;
    Set *sets; /* of the run of the same number */
    Node *nodes;
    int32_t *pairs, *sorted;
    uint8_t *levels; /* at which pairs are joined */
    int count, pair_count, node_count;
} Forest;

static int root_of(Set *sets, int at)
{
    while (sets[at].up != at) at = sets[at].up = sets[sets[at].up].up;
    return at;
}

static void closed(Forest *f, Set *set)
{
    Node *node = f->nodes + f->node_count;
    memset(node, 0, sizeof *node);
    node->level = set->level, node->area = set->area;
    node->left = node->top = INT32_MAX;
    node->parent = node->next = -1;
    node->size = 1;
    for (int kid = set->kids; kid >= 0; kid = f->nodes[kid].next) {
        f->nodes[kid].parent = f->node_count;
        node->size += f->nodes[kid].size;
        if (f->nodes[kid].area > node->part) node->part = f->nodes[kid].area;
    }
    for (int run = set->free; run >= 0; run = f->runs[run].next) f->runs[run].node = f->node_count;
    set->free = set->free_last = -1;
    set->kids = set->kids_last = f->node_count++;
}

static void united(Forest *f, int a, int b, int level, int smallest)
{
    a = root_of(f->sets, a), b = root_of(f->sets, b);
    if (a == b) return;
    if (f->sets[a].area < f->sets[b].area) {
        const int other = a;
        a = b, b = other;
    }
    Set *one = f->sets + a, *two = f->sets + b;
    if (one->level > level && one->area >= smallest) closed(f, one);
    if (two->level > level && two->area >= smallest) closed(f, two);
    two->up = a;
    one->level = level;
    one->area += two->area;
    if (two->free >= 0) {
        if (one->free < 0) one->free = two->free;
        else f->runs[one->free_last].next = two->free;
        one->free_last = two->free_last;
    }
    if (two->kids >= 0) {
        if (one->kids < 0) one->kids = two->kids;
        else f->nodes[one->kids_last].next = two->kids;
        one->kids_last = two->kids_last;
    }
}

/* Where the bytes of a row change: ends[i] is one past the last of each run of equal bytes. */
static int changes_of(const uint8_t *line, int width, int16_t *ends)
{
    int count = 0, u = 1;
    for (; u + 8 <= width; u += 8) {
        uint64_t here, before;
        memcpy(&here, line + u, 8);
        memcpy(&before, line + u - 1, 8);
        if (here == before) continue;
        for (int k = 0; k < 8; k++) {
            ends[count] = u + k;
            count += line[u + k] != line[u + k - 1];
        }
    }
    for (; u < width; u++)
        if (line[u] != line[u - 1]) ends[count++] = u;
    ends[count++] = width;
    return count;
}

/* Runs of equal height and which of them touch: 4-connected. ends: (width + 8). */
static void runs_of(Forest *f, const uint8_t *height, int rows, int width, int16_t *ends)
{
    int before = 0, before_end = 0;
    int32_t *pair = f->pairs;
    uint8_t *level = f->levels;
    f->count = 0;
    for (int v = 0; v < rows; v++) {
        const uint8_t *line = height + (size_t)v * width;
        const int begin = f->count, changes = changes_of(line, width, ends);
        Run *run = f->runs + begin;
        for (int i = 0, u = 0; i < changes; u = ends[i++]) {
            *run = (Run){v, u, ends[i], line[u], -1, -1};
            run += line[u] > 0;
        }
        f->count = run - f->runs;
        for (int i = begin; i < f->count; i++) {
            const Run *one = f->runs + i;
            f->sets[i] = (Set){i, one->height, one->end - one->begin, i, i, -1, -1};
            pair[0] = i - 1, pair[1] = i;
            *level = one->height < one[-1 + (i == begin)].height ? one->height : one[-1 + (i == begin)].height;
            const int touch = i > begin && one[-1].end == one->begin;
            pair += 2 * touch, level += touch;
        }
        for (int a = before, b = begin; a < before_end && b < f->count;) {
            const Run *one = f->runs + a, *two = f->runs + b;
            pair[0] = a, pair[1] = b;
            *level = one->height < two->height ? one->height : two->height;
            const int touch = one->begin < two->end && two->begin < one->end;
            pair += 2 * touch, level += touch;
            const int first = one->end < two->end;
            a += first, b += !first;
        }
        before = begin, before_end = f->count;
    }
    f->pair_count = (pair - f->pairs) / 2;
}

/* From the highest level down, as Kruskal joins a tree's branches. */
static void grown(Forest *f, int smallest)
{
    int of_level[257] = {0};
    for (int i = 0; i < f->pair_count; i++) of_level[255 - f->levels[i] + 1]++;
    for (int i = 0; i < 256; i++) of_level[i + 1] += of_level[i];
    for (int i = 0; i < f->pair_count; i++) {
        const int at = of_level[255 - f->levels[i]]++;
        f->sorted[2 * at] = f->pairs[2 * i], f->sorted[2 * at + 1] = f->pairs[2 * i + 1];
    }
    f->node_count = 0;
    for (int i = 0, level = 255; i < f->pair_count; i++) {
        while (i >= of_level[255 - level]) level--;
        united(f, f->sorted[2 * i], f->sorted[2 * i + 1], level, smallest);
    }
    for (int i = 0; i < f->count; i++)
        if (f->sets[i].up == i && f->sets[i].area >= smallest) closed(f, f->sets + i);
}

static void lower(int32_t *least, int value) { *least = value < *least ? value : *least; }
static void raise(int32_t *most, int value) { *most = value > *most ? value : *most; }

/* What the pixels of each node sum up to: of its own runs, then of its parts. */
static void totalled(Forest *f, const int32_t *sums, int width)
{
    for (int i = 0; i < f->count; i++) {
        const Run *run = f->runs + i;
        if (run->node < 0) continue;
        Node *node = f->nodes + run->node;
        const int length = run->end - run->begin;
        const int32_t *over = sums + ((size_t)run->row * (width + 1) + run->begin) * SUMS;
        const int32_t *under = over + (size_t)(width + 1) * SUMS;
        lower(&node->left, run->begin), lower(&node->top, run->row);
        raise(&node->right, run->end), raise(&node->bottom, run->row + 1);
        node->sum_u += (run->begin + run->end - 1) * length / 2, node->sum_v += run->row * length;
        for (int k = 0; k < 3; k++) node->color[k] += under[length * SUMS + k] - under[k] - over[length * SUMS + k] + over[k];
    }
    for (int i = 0; i < f->node_count; i++) {
        const Node *node = f->nodes + i;
        if (node->parent < 0) continue;
        Node *parent = f->nodes + node->parent;
        lower(&parent->left, node->left), lower(&parent->top, node->top);
        raise(&parent->right, node->right), raise(&parent->bottom, node->bottom);
        parent->sum_u += node->sum_u, parent->sum_v += node->sum_v;
        for (int k = 0; k < 3; k++) parent->color[k] += node->color[k];
    }
}

static void of_node(const Node *node, int32_t *six)
{
    six[0] = node->level, six[1] = node->left, six[2] = node->top;
    six[3] = node->right - node->left, six[4] = node->bottom - node->top, six[5] = node->area;
}

/* heights, place: (count, rows, width). table: (most) rows; as many as
   are returned are filled. limits: smallest, widest, 2 x slimmest, 2 x flattest, lowest. */
int regions(const uint8_t *heights, const int32_t *sums, int rows, int width, int count, const int32_t *limits,
            int32_t *place, Region *table, int most)
{
    if (!is_small(rows, width)) return REFUSED;
    const size_t plane = (size_t)rows * width;
    Forest f;
    int16_t *ends = malloc((width + 8) * sizeof *ends);
    f.runs = malloc((plane + 1) * sizeof *f.runs);
    f.sets = malloc(plane * sizeof *f.sets);
    f.nodes = malloc(plane * sizeof *f.nodes);
    f.pairs = malloc((6 * plane + 2) * sizeof *f.pairs);
    f.sorted = malloc(6 * plane * sizeof *f.sorted);
    f.levels = malloc(3 * plane + 1);
    int found = -1;
    if (f.levels && ends && f.runs && f.sets && f.nodes && f.pairs && f.sorted) {
        found = 0;
        for (int channel = 0; channel < count; channel++) {
            runs_of(&f, heights + channel * plane, rows, width, ends);
            grown(&f, limits[0]);
            totalled(&f, sums, width);
            int roots = 0;
            for (int i = f.node_count - 1; i >= 0; i--) { /* parents come after their parts */
                Node *node = f.nodes + i;
                int *free_number = node->parent < 0 ? &roots : &f.nodes[node->parent].next;
                node->first = *free_number;
                *free_number += node->size;
                node->next = node->first + 1;
            }
            for (int i = 0; i < f.count; i++) {
                const Run *run = f.runs + i;
                const int number = run->node < 0 ? -1 : f.nodes[run->node].first;
                int32_t *line = place + channel * plane + (size_t)run->row * width;
                for (int u = run->begin; u < run->end; u++) line[u] = number;
            }
            for (int i = f.node_count - 1; i >= 0 && found < most; i--) {
                const Node *node = f.nodes + i;
                const int w = node->right - node->left, h = node->bottom - node->top;
                if (w >= limits[1] || 2 * h >= limits[2] * w || 2 * w >= limits[3] * h || node->bottom <= limits[4]) continue;
                Region *region = table + found++;
                memset(region, -1, sizeof *region);
                region->channel = channel, region->level = node->level;
                region->since = node->parent < 0 ? 0 : f.nodes[node->parent].level;
                region->left = node->left, region->top = node->top, region->width = w, region->height = h;
                region->area = node->area, region->sum_u = node->sum_u, region->sum_v = node->sum_v;
                memcpy(region->color, node->color, sizeof node->color);
                region->first = node->first, region->past = node->first + node->size, region->part = node->part;
                if (node->parent >= 0) of_node(f.nodes + node->parent, region->parent);
                int twice = node->parent;
                while (twice >= 0 && f.nodes[twice].area < 2 * node->area) twice = f.nodes[twice].parent;
                if (twice >= 0) of_node(f.nodes + twice, region->twice);
            }
        }
    }
    free(ends), free(f.levels), free(f.runs), free(f.sets), free(f.nodes), free(f.pairs), free(f.sorted);
    return found;
}

/* ---------------------------------------------------------------- features */

typedef struct {
    int32_t rows, width, top, height; /* rows from top on are looked at; height: of the whole working picture */
    const float *nearness, *bearing;
} View;

#define UNIT 64.0
#define NOTHING 30.0f
#define QUICK 37

typedef struct {
    double ahead, aside, width, rise, length;
} Road;

static double limited(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

static Road on_road(const Region *r, const View *view)
{
    const int width = view->width, head = r->top + view->top, foot = head + r->height - 1;
    const int column = clip(r->left + r->width / 2, 1, width - 2), right = r->left + r->width;
    const double nearness = view->nearness[foot * width + column], above = view->nearness[head * width + column];
    const double one = view->bearing[foot * width + r->left];
    const double other = view->bearing[foot * width + (right < width ? right : width - 1)];
    Road road;
    road.ahead = 1 / limited(nearness, 0.2, 20);
    road.aside = view->bearing[foot * width + column] * road.ahead;
    road.width = fabs(one - other) * road.ahead;
    road.rise = 1 - limited(above / (nearness > 1e-3 ? nearness : 1e-3), -2, 1);
    road.length = limited(1 / limited(above, 0.2, 20) - road.ahead, 1e-3, 5);
    return road;
}

static const int32_t *corner(const int32_t *sums, int width, int v, int u)
{
    return sums + ((size_t)v * (width + 1) + u) * SUMS;
}

static float *compared(float *out, const int32_t *larger, const Region *r)
{
    if (larger[0] < 0) {
        for (int i = 0; i < 6; i++) *out++ = NOTHING;
        return out;
    }
    *out++ = r->level - larger[0];
    *out++ = (double)larger[5] / r->area;
    *out++ = (double)larger[3] / r->width;
    *out++ = (double)larger[4] / r->height;
    *out++ = (double)(larger[2] + larger[4] - r->top - r->height) / r->height;
    *out++ = (double)(r->top - larger[2]) / r->height;
    return out;
}

/* out: (count, QUICK). */
int quick(const Region *table, int count, const int32_t *sums, const View *view, float *out)
{
    const int width = view->width, rows = view->rows;
    if (!is_small(rows, width)) return REFUSED;
    for (const Region *r = table; r < table + count; r++) {
        const Road road = on_road(r, view);
        const int x = r->left, y = r->top, w = r->width, h = r->height;
        *out++ = r->channel;
        *out++ = r->level;
        *out++ = r->level - r->since;
        *out++ = (double)w / h;
        *out++ = (double)r->area / (w * h);
        *out++ = w;
        *out++ = h;
        *out++ = fabs(((double)r->sum_u / r->area - x) / w - 0.5);
        *out++ = ((double)r->sum_v / r->area - y) / h;
        *out++ = road.ahead;
        *out++ = fabs(road.aside);
        *out++ = road.width;
        *out++ = road.rise;
        *out++ = (road.rise > 1e-2 ? road.rise : 1e-2) / (road.width > 1e-3 ? road.width : 1e-3);
        *out++ = road.length;
        for (int i = 0; i < 3; i++) *out++ = (double)r->color[i] / r->area / UNIT;
        const int left = clip(x - (w + 1) / 2, 0, width), right = clip(x + w + (w + 1) / 2, 0, width);
        const int above = clip(y - (h + 1) / 2, 0, rows), below = clip(y + h + (h + 1) / 2, 0, rows);
        const int32_t *a = corner(sums, width, above, left), *b = corner(sums, width, above, right);
        const int32_t *c = corner(sums, width, below, left), *d = corner(sums, width, below, right);
        const int size = (right - left) * (below - above) - r->area;
        for (int i = 0; i < 3; i++) {
            const double ring = (double)(d[i] - c[i] - b[i] + a[i] - r->color[i]) / (size > 0 ? size : 1) / UNIT;
            *out++ = ring - (double)r->color[i] / r->area / UNIT;
        }
        *out++ = (double)r->part / r->area;
        out = compared(out, r->parent, r);
        out = compared(out, r->twice, r);
        *out++ = x <= 0 || x + w >= width;
        *out++ = y + h + view->top >= view->height;
        *out++ = y <= 0;
    }
    return 0;
}

#define OWN_CELLS 10
#define CELLS 6
#define AROUND_CELLS 7

/* first and past: (cells), at least a pixel and inside. */
static void bounds(int *first, int *past, int cells, double low, double own, double grid, double across, int most)
{
    int before = 0;
    for (int k = 0; k <= cells; k++) {
        const int at = (int)floor(low + own / 2 + grid * (((double)k / cells - 0.5) * across) + 0.5);
        if (k) {
            const int end = clip(at, 0, most);
            past[k - 1] = end > first[k - 1] ? end : first[k - 1] + 1;
        }
        before = clip(at, 0, most - 1);
        if (k < cells) first[k] = before;
    }
}

/* means: (cells, cells, SUMS). */
static void means(const int32_t *sums, const View *view, const Region *r, int cells, double across, int square, double *out)
{
    int left[8], right[8], top[8], bottom[8];
    const double longer = r->width > r->height ? r->width : r->height;
    bounds(left, right, cells, r->left, r->width, square ? longer : r->width, across, view->width);
    bounds(top, bottom, cells, r->top, r->height, square ? longer : r->height, across, view->rows);
    for (int j = 0; j < cells; j++)
        for (int i = 0; i < cells; i++) {
            const int32_t *a = corner(sums, view->width, top[j], left[i]), *b = corner(sums, view->width, top[j], right[i]);
            const int32_t *c = corner(sums, view->width, bottom[j], left[i]), *d = corner(sums, view->width, bottom[j], right[i]);
            const int size = (right[i] - left[i]) * (bottom[j] - top[j]);
            for (int k = 0; k < SUMS; k++) *out++ = (double)(d[k] - c[k] - b[k] + a[k]) / size / UNIT;
        }
}

static float *own(const Region *r, const View *view, const uint8_t *heights, const int32_t *place, double grown, float *out)
{
    const size_t plane = (size_t)view->rows * view->width;
    const uint8_t *height = heights + r->channel * plane;
    const int32_t *number = place + r->channel * plane;
    const int peak_of[2] = {0, 3};
    int is_own[OWN_CELLS][OWN_CELLS] = {{0}}, peaks[2] = {0}, u[OWN_CELLS];
    for (int i = 0; i < OWN_CELLS; i++)
        u[i] = (int)floor(r->left + r->width * ((i + 0.5) / OWN_CELLS * (1 + 2 * grown) - grown));
    for (int j = 0; j < OWN_CELLS; j++) {
        const int v = (int)floor(r->top + r->height * ((j + 0.5) / OWN_CELLS * (1 + 2 * grown) - grown));
        if (v < 0 || v >= view->rows) continue;
        for (int i = 0; i < OWN_CELLS; i++) {
            if (u[i] < 0 || u[i] >= view->width) continue;
            const size_t at = (size_t)v * view->width + u[i];
            if (!height[at] || number[at] < r->first || number[at] >= r->past) continue;
            is_own[j][i] = 1;
            for (int k = 0; k < 2; k++)
                if (heights[peak_of[k] * plane + at] > peaks[k]) peaks[k] = heights[peak_of[k] * plane + at];
        }
    }
    double middle[2] = {0, 0};
    for (int j = 2; j < 8; j++) {
        int width = 0, inner = 0, sum = 0;
        for (int i = 0; i < OWN_CELLS; i++) width += is_own[j][i];
        for (int i = 2; i < 8; i++) inner += is_own[j][i], sum += (i - 2) * is_own[j][i];
        *out++ = width / (double)OWN_CELLS;
        if (j == 2 || j == 7) middle[j == 7] = (double)sum / (inner ? inner : 1);
    }
    *out++ = fabs(middle[0] - middle[1]);
    *out++ = peaks[0];
    *out++ = peaks[0] - peaks[1];
    *out++ = peaks[1] - (r->channel == 0 || r->channel == 3 ? r->level : 0);
    for (int j = 0; j < OWN_CELLS; j += 2)
        for (int i = 0; i < OWN_CELLS; i += 2)
            *out++ = (is_own[j][i] + is_own[j][i + 1] + is_own[j + 1][i] + is_own[j + 1][i + 1]) / 4.0;
    return out;
}

static float *beside_lines(const Region *r, const View *view, const double *lines, int count, double no_line, float *out)
{
    const Road road = on_road(r, view);
    const double x = road.ahead, y = road.aside;
    double best[4] = {no_line, no_line, no_line, no_line};
    for (const double *line = lines; line < lines + 7 * count; line += 7) {
        const double f = line[0] + line[1] * x + line[2] * (x * x + y * y) / 2 - y;
        const double along = line[1] + line[2] * x, across = 1 - line[2] * y;
        const double distance = fabs(f) / sqrt(along * along + across * across);
        const double before = line[3] - x, behind = x - line[4];
        const double most = before > behind ? before : behind, beyond = most > 0 ? most : 0;
        if (distance * distance + beyond * beyond >= best[0] * best[0] + best[1] * best[1]) continue;
        best[0] = distance, best[1] = beyond, best[2] = line[5], best[3] = line[6];
    }
    for (int i = 0; i < 4; i++) *out++ = best[i];
    return out;
}

/* table: (count) chosen regions. values: (count, QUICK). lines: (line_count, 7). limits: OWN_GROWN, GROWN, AROUND,
   DIFFERENCE, EVEN, NO_LINE. out: (count, 427). */
int full(const Region *table, int count, const float *values, const int32_t *place, const uint8_t *heights,
         const int32_t *sums, const View *view, const double *lines, int line_count, const double *limits, float *out)
{
    const double most = limits[3], even = limits[4];
    if (!is_small(view->rows, view->width)) return REFUSED;
    double cells[AROUND_CELLS * AROUND_CELLS * SUMS];
    for (int n = 0; n < count; n++) {
        const Region *r = table + n;
        memcpy(out, values + (size_t)n * QUICK, QUICK * sizeof *out);
        out = own(r, view, heights, place, limits[0], out + QUICK);
        out = beside_lines(r, view, lines, line_count, limits[5], out);
        double inside[3], steepness = 0;
        for (int k = 0; k < 3; k++) inside[k] = (float)((double)r->color[k] / r->area / UNIT);
        means(sums, view, r, CELLS, 1 + 2 * limits[1], 0, cells);
        for (int k = 0; k < 3; k++)
            for (int i = 0; i < CELLS * CELLS; i++) *out++ = limited(cells[i * SUMS + k] - inside[k], -most, most);
        for (int i = 0; i < CELLS * CELLS; i++)
            steepness += cells[i * SUMS + 3] + cells[i * SUMS + 4] + cells[i * SUMS + 5] + cells[i * SUMS + 6];
        steepness /= CELLS * CELLS;
        *out++ = steepness;
        for (int k = 3; k < 7; k++)
            for (int i = 0; i < CELLS * CELLS; i++) *out++ = cells[i * SUMS + k] / (steepness + even);
        means(sums, view, r, AROUND_CELLS, limits[2], 1, cells);
        for (int k = 0; k < 3; k += 2)
            for (int i = 0; i < AROUND_CELLS * AROUND_CELLS; i++)
                *out++ = limited(cells[i * SUMS + k] - inside[k], -most, most);
    }
    return 0;
}

/* ------------------------------------------------------------------- trees */

typedef struct {
    int16_t feature, next[2]; /* left, right; a leaf leads to itself */
    int16_t depth;            /* of a root: steps that reach every leaf */
    float value;              /* smaller ones go left; of a leaf what it adds */
} TreeNode;

#define TOGETHER 12 /* rows on their way down a tree at the same time: a step waits for memory */

/* nodes: (trees, size). stages: trees after which a sum below hopeless ends a row. total: (count), base at first. */
int summed(const TreeNode *nodes, int trees, int size, const int32_t *stages, const float *hopeless, int stage_count,
           const float *values, int count, int columns, float *total)
{
    int32_t *going = malloc((size_t)(count + TOGETHER) * sizeof *going);
    if (!going) return -1;
    for (int i = 0; i < count; i++) going[i] = i;
    int left = count, tree = 0;
    for (int stage = 0; stage <= stage_count && left; stage++) {
        const int end = stage < stage_count && stages[stage] < trees ? stages[stage] : trees;
        for (int i = 0; i < TOGETHER; i++) going[left + i] = going[left - 1];
        for (; tree < end; tree++) {
            const TreeNode *root = nodes + (size_t)tree * size;
            for (int i = 0; i < left; i += TOGETHER) {
                const float *row[TOGETHER];
                const TreeNode *node[TOGETHER];
                for (int k = 0; k < TOGETHER; k++) row[k] = values + (size_t)going[i + k] * columns, node[k] = root;
                for (int step = 0; step < root->depth; step++)
                    for (int k = 0; k < TOGETHER; k++) {
                        const int lower = row[k][node[k]->feature] < node[k]->value;
                        node[k] = root + node[k]->next[!lower]; /* no branch: which way is anybody's guess */
                    }
                for (int k = 0; k < TOGETHER && i + k < left; k++) total[going[i + k]] += node[k]->value;
            }
        }
        if (stage == stage_count) break;
        int kept = 0;
        for (int i = 0; i < left; i++) {
            if (total[going[i]] < hopeless[stage]) total[going[i]] = -INFINITY;
            else going[kept++] = going[i];
        }
        left = kept;
    }
    free(going);
    return 0;
}

/* ------------------------------------------------------------------- lines */

/* Between pixels, to 1 / 32 of one, as cv2.remap does it. */
static int between(const uint8_t *picture, int width, int height, const int16_t *pixel, int part, int color)
{
    const int x = part & 31, y = part >> 5, right = pixel[0] + 1 < width ? 3 : 0;
    const size_t below = pixel[1] + 1 < height ? 3 * (size_t)width : 0;
    const uint8_t *at = picture + 3 * ((size_t)pixel[1] * width + pixel[0]) + color;
    const int above = (32 - x) * at[0] + x * at[right], under = (32 - x) * at[below] + x * at[below + right];
    return ((32 - y) * above + y * under + 512) >> 10;
}

/* Tape along the scans of lines.LineSampling. share: of green and red in grey, of 256. limits: lines.find_crossings.
   left, right: (most) positions of its edges. color: (most, 3) sums of linear light over its core. */
int tapes(const uint8_t *picture, int width, int height, const int16_t *pixel, const uint16_t *part, const float *whole,
          const int32_t *scan, int count, const int32_t *share, const double *limits, const float *linear, double *left,
          double *right, double *color, int most)
{
    const double least = limits[0], noise_factor = limits[1], evenness = limits[2], local = limits[3];
    const int longest = limits[4];
    int inside = 0; /* negative when one of the pixels is in no column or row of the picture */
    for (int i = 0; i < count; i++)
        inside |= pixel[2 * i] | (width - 1 - pixel[2 * i]) | pixel[2 * i + 1] | (height - 1 - pixel[2 * i + 1]);
    if (inside < 0) return REFUSED;
    uint8_t *grey = malloc(count + 8);
    int16_t *change = calloc(count + 8, sizeof *change);
    if (!grey || !change) {
        free(grey), free(change);
        return -1;
    }
    for (int i = 0; i < count; i++) {
        const int g = between(picture, width, height, pixel + 2 * i, part[i], 1);
        const int r = between(picture, width, height, pixel + 2 * i, part[i], 2);
        grey[i] = (share[0] * g + share[1] * r + 128) >> 8;
    }
    for (int i = 3; i < count - 3; i++)
        change[i] = whole[i] ? grey[i + 1] + grey[i + 2] + grey[i + 3] - grey[i - 1] - grey[i - 2] - grey[i - 3] : 0;
    int of_size[766] = {0}, found = 0, rise = -1, size = 0;
    for (int i = 0; i < count; i += 29) of_size[abs(change[i])]++;
    for (int seen = of_size[0]; seen <= (count + 28) / 29 / 2 && size < 765;) seen += of_size[++size];
    const double threshold = 3 * least > noise_factor * size ? 3 * least : noise_factor * size;
    for (int i = 4; i < count - 4 && found < most; i++) {
        const int here = change[i];
        if (here > threshold && here >= change[i - 1] && here > change[i + 1]) rise = i;
        if (-here <= threshold || -here < -change[i - 1] || -here <= -change[i + 1] || rise < 0) continue;
        const int up = change[rise], down = -here;
        if (scan[rise] != scan[i] || i - rise >= longest || up <= evenness * down || down <= evenness * up) continue;
        if (up <= 3 * local * grey[rise - 3] || down <= 3 * local * grey[i + 3]) continue;
        double *edge = left + found;
        for (int k = 0; k < 2; k++, edge = right + found) {
            const int at = k ? i : rise, sign = k ? -1 : 1;
            const double before = sign * change[at - 1], value = sign * change[at], after = sign * change[at + 1];
            *edge = at + (before - after) / (2 * (before + after) - 4 * value - 3e-3);
        }
        const int core = (int)((left[found] + right[found]) / 2 + 0.5);
        for (int k = 0; k < 3; k++) {
            double sum = 0;
            for (int j = core - 1; j <= core + 1; j++) sum += linear[between(picture, width, height, pixel + 2 * j, part[j], k)];
            color[3 * found + k] = sum;
        }
        found++;
    }
    free(grey), free(change);
    return found;
}

#define MOST_CROSSINGS 192 /* 64 to a word */
#define WORDS (MOST_CROSSINGS / 64)

typedef struct {
    uint64_t near[WORDS], beside[WORDS];
    double gaps;
} Curve;

static int counted(const uint64_t *a, const uint64_t *b)
{
    int count = 0;
    for (int i = 0; i < WORDS; i++) count += __builtin_popcountll(a[i] & b[i]);
    return count;
}

/* Which crossings, at most MOST_CROSSINGS, the curves share that most crossings lie on. trials: (3, tries) numbers of
   crossings. limits: LEAST_APART, SHARPEST, STEEPEST, DENSITY, LEAST_CROSSINGS. chosen: (most, count), a row a curve. */
int curves(const double *x, const double *y, const int64_t *row, const double *tolerance, int count, const int32_t *trials,
           int tries, const double *limits, uint8_t *chosen, int most)
{
    const double apart = limits[0] * limits[0];
    if (count > MOST_CROSSINGS) return REFUSED;
    for (int t = 0; t < 3 * tries; t++)
        if (trials[t] < 0 || trials[t] >= count) return REFUSED;
    Curve *tried = malloc(tries * sizeof *tried);
    if (!tried) return -1;
    int good = 0;
    for (int t = 0; t < tries; t++) {
        const int end[3] = {trials[t], trials[tries + t], trials[2 * tries + t]}, i = end[0], j = end[1], k = end[2];
        const double qi = (x[i] * x[i] + y[i] * y[i]) / 2;
        const double xj = x[j] - x[i], xk = x[k] - x[i], yj = y[j] - y[i], yk = y[k] - y[i];
        const double qj = (x[j] * x[j] + y[j] * y[j]) / 2 - qi, qk = (x[k] * x[k] + y[k] * y[k]) / 2 - qi;
        const double divisor = xj * qk - xk * qj;
        if (xj * xj + yj * yj <= apart || xk * xk + yk * yk <= apart) continue;
        if ((xj - xk) * (xj - xk) + (yj - yk) * (yj - yk) <= apart || fabs(divisor) <= 1e-6) continue;
        const double b = (yj * qk - yk * qj) / divisor, c = (xj * yk - xk * yj) / divisor, a = y[i] - b * x[i] - c * qi;
        const double squared = b * b + 1 - 2 * a * c, length = sqrt(squared > 0.01 ? squared : 0.01);
        int steep = fabs(c) >= limits[1] * length;
        for (int e = 0; e < 3; e++) steep |= fabs(b + c * x[end[e]]) >= limits[2] * (1 - c * y[end[e]]);
        if (steep) continue;
        Curve *curve = tried + good;
        memset(curve, 0, sizeof *curve);
        int first = -1, last = -1;
        for (int n = 0; n < count; n++) {
            const double beside = fabs((a + b * x[n] + c * (x[n] * x[n] + y[n] * y[n]) / 2 - y[n]) / length);
            if (beside < 2 * tolerance[n]) curve->beside[n / 64] |= 1ull << n % 64;
            if (beside >= tolerance[n]) continue;
            curve->near[n / 64] |= 1ull << n % 64;
            first = first < 0 ? n : first, last = n;
        }
        curve->gaps = first < 0 ? 0 : limits[3] * (row[last] - row[first]);
        good++;
    }
    uint64_t left[WORDS];
    memset(left, 255, sizeof left);
    int found = 0;
    while (found < most && good) {
        int best = 0;
        double best_score = -INFINITY;
        for (int t = 0; t < good; t++) {
            const double score = counted(tried[t].near, left) - tried[t].gaps;
            if (score > best_score) best = t, best_score = score;
        }
        if (counted(tried[best].near, left) < limits[4]) break;
        for (int n = 0; n < count; n++) chosen[found * count + n] = (tried[best].near[n / 64] & left[n / 64]) >> n % 64 & 1;
        for (int i = 0; i < WORDS; i++) left[i] &= ~tried[best].beside[i];
        found++;
    }
    free(tried);
    return found;
}

#define MOST_CURVES 8

typedef struct {
    double a, b, c, covariance[9], residual, width, blueness, brightness;
} Line;

/* Their inverse and what it makes of the right side, of a symmetric matrix. */
static void solved(const double *m, const double *right, double *inverse, double *values)
{
    const double aa = m[4] * m[8] - m[5] * m[5], ab = m[2] * m[5] - m[1] * m[8], ac = m[1] * m[5] - m[2] * m[4];
    const double bb = m[0] * m[8] - m[2] * m[2], bc = m[1] * m[2] - m[0] * m[5], cc = m[0] * m[4] - m[1] * m[1];
    const double all = m[0] * aa + m[1] * ab + m[2] * ac, six[9] = {aa, ab, ac, ab, bb, bc, ac, bc, cc};
    for (int i = 0; i < 9; i++) inverse[i] = six[i] / all;
    for (int i = 0; i < 3; i++) values[i] = inverse[3 * i] * right[0] + inverse[3 * i + 1] * right[1] + inverse[3 * i + 2] * right[2];
}

/* Crossings in their order along the line, without the few at either end that a gap separates. Returns how many. */
static int in_line(int32_t *numbers, double *along, int count, const double *x, const double *y, const double *limits)
{
    const int few = limits[7];
    int near = numbers[0], far = numbers[0], begin = 0, gap = 0;
    for (int i = 1; i < count; i++) {
        const int n = numbers[i];
        if (x[n] * x[n] + y[n] * y[n] < x[near] * x[near] + y[near] * y[near]) near = n;
        if (x[n] * x[n] + y[n] * y[n] > x[far] * x[far] + y[far] * y[far]) far = n;
    }
    for (int i = 0; i < count; i++) {
        const int n = numbers[i];
        const double value = (x[n] - x[near]) * (x[far] - x[near]) + (y[n] - y[near]) * (y[far] - y[near]);
        int at = i;
        for (; at > 0 && along[at - 1] > value; at--) along[at] = along[at - 1], numbers[at] = numbers[at - 1];
        along[at] = value, numbers[at] = n;
    }
    int first_gap = 0, last_gap = 0;
    for (int i = 1; i < count; i++) {
        const int n = numbers[i], m = numbers[i - 1];
        const double most = limits[5] + limits[6] * x[n];
        if ((x[n] - x[m]) * (x[n] - x[m]) + (y[n] - y[m]) * (y[n] - y[m]) <= most * most) continue;
        first_gap = gap++ ? first_gap : i, last_gap = i;
    }
    if (gap && first_gap < few) begin = first_gap, gap--;
    if (gap && count - last_gap < few) count = last_gap;
    memmove(numbers, numbers + begin, (count - begin) * sizeof *numbers);
    return count - begin;
}

/* Least squares through the crossings of each curve, (curve_count, count). limits: ERROR, ERROR_GROWTH, LEAST_ERROR,
   LEAST_CROSSINGS, LEAST_LENGTH, GAP, GAP_GROWTH, FEW, prior of a and b, prior of c. numbers: (curve_count, count)
   crossings of each line, from the robot on, sizes: how many. Returns the number of lines. */
int fitted(const double *x, const double *y, const double *across, const double *color, const double *tolerance, int count,
           uint8_t *chosen, int curve_count, const double *limits, Line *lines, int32_t *numbers, int32_t *sizes)
{
    double inverse[MOST_CURVES][9], values[MOST_CURVES][3], scale[MOST_CURVES];
    if (curve_count > MOST_CURVES) return REFUSED;
    if (curve_count < 1) return 0;
    double *beside = malloc(((size_t)curve_count + 1) * (count + 1) * sizeof *beside);
    if (!beside) return -1;
    double *sorted = beside + (size_t)curve_count * count;
    for (int round = 0; round < 2; round++) {
        for (int l = 0; l < curve_count; l++) {
            double m[9] = {limits[8], 0, 0, 0, limits[8], 0, 0, 0, limits[9]}, right[3] = {0};
            for (int n = 0; n < count; n++) {
                if (!chosen[l * count + n]) continue;
                const double error = (limits[0] + limits[1] * x[n]) * (round ? scale[l] : 1), weight = 1 / (error * error);
                const double q = (x[n] * x[n] + y[n] * y[n]) / 2;
                m[0] += weight, m[1] += weight * x[n], m[2] += weight * q;
                m[4] += weight * x[n] * x[n], m[5] += weight * x[n] * q, m[8] += weight * q * q;
                right[0] += weight * y[n], right[1] += weight * x[n] * y[n], right[2] += weight * q * y[n];
            }
            solved(m, right, inverse[l], values[l]);
            const double *v = values[l], squared = v[1] * v[1] + 1 - 2 * v[0] * v[2];
            scale[l] = sqrt(squared > 0.1 ? squared : 0.1);
            for (int n = 0; n < count; n++)
                beside[l * count + n] = (v[0] + v[1] * x[n] + v[2] * (x[n] * x[n] + y[n] * y[n]) / 2 - y[n]) / scale[l];
        }
        for (int n = 0; n < count; n++) {
            int best = 0;
            for (int l = 0; l < curve_count; l++) {
                if (fabs(beside[l * count + n]) < fabs(beside[best * count + n])) best = l;
                chosen[l * count + n] = 0;
            }
            chosen[best * count + n] = fabs(beside[best * count + n]) < tolerance[n];
        }
    }
    int found = 0;
    for (int l = 0; l < curve_count; l++) {
        int32_t *own = numbers + (size_t)found * count;
        int size = 0;
        for (int n = 0; n < count; n++)
            if (chosen[l * count + n]) own[size++] = n;
        if (size < limits[3]) continue;
        size = in_line(own, sorted, size, x, y, limits);
        if (size < limits[3] || hypot(x[own[size - 1]] - x[own[0]], y[own[size - 1]] - y[own[0]]) < limits[4]) continue;
        const double b = values[l][1], c = values[l][2];
        double sum = 0, blue = 0, rest = 0;
        for (int i = 0; i < size / 2 + 1; i++) { /* the far half is blurred */
            const int n = own[i];
            const double square = fabs(across[2 * n + 1] * (1 - c * y[n]) - across[2 * n] * (b + c * x[n]));
            int at = i;
            for (; at > 0 && sorted[at - 1] > square; at--) sorted[at] = sorted[at - 1];
            sorted[at] = square;
        }
        for (int i = 0; i < size; i++) {
            const int n = own[i];
            sum += beside[l * count + n] * beside[l * count + n];
            blue += color[3 * n], rest += color[3 * n + 1] + color[3 * n + 2];
        }
        Line *line = lines + found;
        line->a = values[l][0], line->b = b, line->c = c;
        line->residual = sqrt(sum / (size > 4 ? size - 3 : 1));
        const double error = line->residual / (limits[0] + limits[1] * x[own[size / 2]]);
        const double factor = error > limits[2] ? error : limits[2];
        for (int i = 0; i < 9; i++) line->covariance[i] = inverse[l][i] * factor * factor;
        line->width = sorted[size / 4] / scale[l];
        line->blueness = 2 * blue / (rest > 1e-6 ? rest : 1e-6), line->brightness = rest / (2 * size);
        sizes[found++] = size;
    }
    free(beside);
    return found;
}
