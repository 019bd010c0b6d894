#define _GNU_SOURCE /* close_range, mremap's numbers */
#include "confine.h"

#include <errno.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#else
#define ARCHITECTURE 0 /* none: no filter is made */
#endif

#define OTHER_TABLE 0x40000000u /* calls of the x32 table, which have numbers of their own */

static bool limit(int what, rlim_t most)
{
    const struct rlimit r = { most, most };

    return setrlimit((__rlimit_resource_t)what, &r) == 0;
}

int confine_limits(size_t address_bytes, unsigned seconds)
{
    close_range(6, ~0u, 0); /* what somebody may have left open; none of ours is */
#ifdef __SANITIZE_ADDRESS__
    address_bytes = RLIM_INFINITY; /* its shadow is larger than any limit */
#endif
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_DUMPABLE, 0, 0, 0, 0) != 0)
        return errno;
    if (!limit(RLIMIT_AS, address_bytes) || !limit(RLIMIT_CPU, seconds) ||
        !limit(RLIMIT_NOFILE, 6) /* that which it has */ || !limit(RLIMIT_FSIZE, 0) || !limit(RLIMIT_CORE, 0) ||
        !limit(RLIMIT_NPROC, 0) || !limit(RLIMIT_MEMLOCK, 0) || !limit(RLIMIT_MSGQUEUE, 0))
        return errno;
    return 0;
}

/* The filter is a program for the kernel's packet filter over struct seccomp_data. Steps of it: */
#define LOAD(field) BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offsetof(struct seccomp_data, field))
#define DIE BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS)
#define ALLOW BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)
#define UNLESS(value) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, (value), 0, 1) /* skips one step when it is another */
#define LET(call) UNLESS(__NR_##call), ALLOW
/* Lower halves: protection and flags are ints, and those of the upper half the kernel does not look at. */
#define LOWER(n) BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offsetof(struct seccomp_data, args[n]))

int confine_calls(void)
{
    static struct sock_filter steps[] = {
        LOAD(arch),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0),
        DIE,
        LOAD(nr),
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, OTHER_TABLE, 0, 1),
        DIE,
        LET(read),
        LET(write),
        LET(futex),
        LET(getrandom), /* of malloc */
        LET(brk),
        LET(munmap),
        LET(madvise),
        LET(mremap),
        LET(clock_gettime),
        LET(rt_sigreturn),
        LET(restart_syscall),
        LET(exit),
        LET(exit_group),
#ifdef __SANITIZE_ADDRESS__ /* which has to write its report */
        LET(getpid),
        LET(gettid),
        LET(sched_yield),
        LET(sigaltstack),
        LET(rt_sigprocmask),
        LET(rt_sigaction),
#endif
        /* memory that is not executed, and not a file's */
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, __NR_mprotect, 0, 4),
        LOWER(2),
        BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, PROT_EXEC, 0, 1),
        DIE,
        ALLOW,
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, __NR_mmap, 0, 6),
        LOWER(2),
        BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, PROT_EXEC, 3, 0),
        LOWER(3),
        BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, MAP_ANONYMOUS, 0, 1),
        ALLOW,
        DIE,
        DIE,
    };
    const struct sock_fprog program = { (unsigned short)(sizeof(steps) / sizeof(steps[0])), steps };

    if (ARCHITECTURE == 0)
        return ENOSYS;
    return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program, 0, 0) == 0 ? 0 : errno;
}
