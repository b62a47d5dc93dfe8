
/* A program's side of its exchange page. */
struct armplane {
    struct armplane_exchange_head *head;
    struct armplane_exchange_topic *topics;
    unsigned char *page;
    uint32_t seen; /* requests answered */
    char error[ARMPLANE_EXCHANGE_TEXT];
};

static inline long armplane_futex(ARMPLANE_ATOMIC_U32 *word, int operation, uint32_t value, const struct timespec *limit) {
    return syscall(SYS_futex, (void *)word, operation, value, limit, NULL, 0);
}

/* Tells armplane that the program refuses the page, and why. Returns 1. */
static inline int armplane_refuse(struct armplane *a, const char *why) {
    snprintf(a->error, sizeof a->error, "%s", why);
    if (a->page) {
        memcpy(a->head->complaint, a->error, sizeof a->error);
        ARMPLANE_STORE(a->head->program, ARMPLANE_PROGRAM_REFUSED);
    }
    return 1;
}

/* Maps the page that the environment names. 0: done. The program then names its topics, and says that it is ready. */
static inline int armplane_join(struct armplane *a) {
    memset(a, 0, sizeof *a);
    const char *path = getenv("ARMPLANE_EXCHANGE");
    if (!path) return armplane_refuse(a, "ARMPLANE_EXCHANGE is not set: armplane starts this program, `armplane run SCENARIO --graph FILE.toml`");
    int file = open(path, O_RDWR);
    struct stat about;
    if (file < 0 || fstat(file, &about)) {
        snprintf(a->error, sizeof a->error, "%s: %s", path, strerror(errno));
        if (file >= 0) close(file);
        return 1;
    }
    void *page = mmap(NULL, (size_t)about.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (page == MAP_FAILED || (size_t)about.st_size < sizeof(struct armplane_exchange_head)) {
        snprintf(a->error, sizeof a->error, "%s is no exchange page", path);
        return 1;
    }
    struct armplane_exchange_head *head = (struct armplane_exchange_head *)page;
    if (head->mark != ARMPLANE_EXCHANGE_MARK || head->bytes != (uint64_t)about.st_size) {
        snprintf(a->error, sizeof a->error, "%s is no exchange page", path);
        return 1;
    }
    head->program_version = ARMPLANE_EXCHANGE_VERSION;
    if (head->version != ARMPLANE_EXCHANGE_VERSION) {
        snprintf(a->error, sizeof a->error, "armplane speaks version %u of the exchange page, this program version %u",
                 (unsigned)head->version, (unsigned)ARMPLANE_EXCHANGE_VERSION);
        /* Of another version only the first fields are known. */
        ARMPLANE_STORE(head->program, ARMPLANE_PROGRAM_REFUSED);
        return 1;
    }
    a->page = (unsigned char *)page;
    a->head = head;
    head->program_pid = (uint32_t)getpid();
    a->topics = (struct armplane_exchange_topic *)(a->page + head->topics_at);
    return 0;
}

/* The message of a topic on the page, NULL where the graph does not give the topic to this process; says which layout the program uses. */
static inline void *armplane_use(struct armplane *a, const char *topic, const char *type_name, uint64_t layout) {
    for (uint32_t i = 0; i < a->head->topics; i++) {
        struct armplane_exchange_topic *entry = &a->topics[i];
        if (strcmp((const char *)entry->name, topic) == 0) {
            snprintf((char *)entry->program_type, sizeof entry->program_type, "%s", type_name);
            entry->program_layout = layout;
            return a->page + entry->at;
        }
    }
    return NULL;
}
#define ARMPLANE_USE(a, topic, structure, NAME) \
    ((struct armplane_##structure *)armplane_use((a), topic, ARMPLANE_##NAME##_TYPE, ARMPLANE_##NAME##_LAYOUT))

/* Whether the message of a topic belongs to the request in hand. */
static inline int armplane_is_fresh(const struct armplane *a, const void *message) {
    for (uint32_t i = 0; i < a->head->topics; i++) {
        if (a->page + a->topics[i].at == (const unsigned char *)message) return a->topics[i].fresh != 0;
    }
    return 0;
}

/* Says that the program is ready. 0: done. */
static inline int armplane_ready(struct armplane *a) {
    ARMPLANE_STORE(a->head->program, ARMPLANE_PROGRAM_JOINED);
    return 0;
}

/* Answers the request in hand. */
static inline void armplane_answer(struct armplane *a, uint32_t answer) {
    a->head->answer_tick = a->head->tick;
    a->head->answer = answer;
    ARMPLANE_STORE(a->head->answers, a->seen);
    armplane_futex(&a->head->answers, FUTEX_WAKE, 1, NULL);
}

/* Waits for the next request and returns it; requests to start are answered here. ARMPLANE_REQUEST_STOP also where armplane is gone. */
static inline uint32_t armplane_next(struct armplane *a) {
    const struct timespec limit = {0, 500000000};
    for (;;) {
        uint32_t requests = ARMPLANE_LOAD(a->head->requests);
        if (requests != a->seen) {
            a->seen = requests;
            if (a->head->request != ARMPLANE_REQUEST_START) return a->head->request;
            armplane_answer(a, ARMPLANE_ANSWER_DONE);
        } else if (armplane_futex(&a->head->requests, FUTEX_WAIT, requests, &limit) && errno == ETIMEDOUT
                   && kill((pid_t)a->head->armplane_pid, 0) && errno == ESRCH) {
            snprintf(a->error, sizeof a->error, "armplane is gone");
            return ARMPLANE_REQUEST_STOP;
        }
    }
}

/* Ends the program after a request to stop: prints armplane's reason, where there is one. The exit code. */
static inline int armplane_end(struct armplane *a) {
    if (a->error[0] == 0 && a->head) memcpy(a->error, a->head->reason, sizeof a->error);
    if (a->error[0] == 0) return 0;
    fprintf(stderr, "%.*s\n", (int)sizeof a->error, a->error);
    return 1;
}

/* Ends a program that could not join. The exit code. */
static inline int armplane_failed(struct armplane *a) {
    fprintf(stderr, "%.*s\n", (int)sizeof a->error, a->error);
    return 1;
}

#endif
