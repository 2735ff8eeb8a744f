// Runs Betaflight's simulator target in lockstep without changing it: LD_PRELOAD puts these functions before the C library's.
//
// The firmware is one thread and three workers [src/platform/SIMULATOR/sitl.c: systemInit]. Here the two that receive UDP packets
// are coroutines of the main thread, and the third, which serves TCP, does not run. So nothing depends on the scheduling of
// threads, no port is open, and a fork copies a running firmware.
//
// Time is simulated. Each reading of the clock takes kReadingNs, and a sleep takes its duration. Where a tick is over, the clock
// stands at its end: the motors are sent to the simulator, and the next state and sticks are received.
//
// If FLOCKSTEP_LOCKSTEP is not set, only bind() is replaced: ports are chosen by the system and open on this machine only.
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dlfcn.h>
#include <netinet/in.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <ucontext.h>
#include <unistd.h>

enum { kReadingNs = 1000, kSticks = 0, kState = 1, kLinks = 2, kStack = 1 << 18, kPortOfMotors = 9002, kStartNs = 1000000000 };

typedef struct {  // a packet from the simulator
  int64_t tick_ns;  // 0: fork; the file descriptor that comes with it is the socket of the copy
  int64_t has_packets;  // 0 while the firmware starts: it forgets that it has received sticks when it initialises the receiver
  uint8_t state[144];  // fdm_packet
  uint8_t sticks[40];  // rc_packet
} Request;

typedef struct {
  void* (*run)(void*);
  const void* packet;  // one to be received
  size_t size;
  ucontext_t context;
  char stack[kStack];
} Link;

static int simulator = -1;  // socket to the simulator; -1: no lockstep
static int64_t now_ns = kStartNs, end_ns = kStartNs;
static Request request;
static float motors[4];
static Link links[kLinks];
static int workers;
static Link* running;  // NULL: the main thread
static ucontext_t main_context;
static int asked_port;  // of the last bind()

__attribute__((constructor)) static void begin(void) {
  const char* name = getenv("FLOCKSTEP_LOCKSTEP");
  if (name == NULL) return;
  simulator = atoi(name);
  signal(SIGCHLD, SIG_IGN);  // nobody waits for the copies
}

// Receives a request. Copies of this process begin with one, too.
static void receive(void) {
  for (;;) {
    char control[CMSG_SPACE(sizeof(int))];
    struct iovec data = {&request, sizeof request};
    struct msghdr message = {.msg_iov = &data, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
    if (recvmsg(simulator, &message, 0) != (ssize_t)sizeof request) _exit(0);  // the simulator has ended
    if (request.tick_ns > 0) return;
    const struct cmsghdr* header = CMSG_FIRSTHDR(&message);
    if (header == NULL) _exit(1);
    int copy;
    memcpy(&copy, CMSG_DATA(header), sizeof copy);
    if (fork() == 0) {
      close(simulator);
      simulator = copy;
    } else {
      close(copy);
    }
  }
}

static void deliver(Link* link, const void* packet, size_t size) {
  if (link->run == NULL) return;
  link->packet = packet;
  link->size = size;
  running = link;
  swapcontext(&main_context, &link->context);
  running = NULL;
}

static void exchange(void) {
  static int is_first = 1;
  if (!is_first && send(simulator, motors, sizeof motors, MSG_NOSIGNAL) != (ssize_t)sizeof motors) _exit(0);
  is_first = 0;
  receive();
  end_ns += request.tick_ns;
  if (!request.has_packets) return;
  deliver(&links[kSticks], request.sticks, sizeof request.sticks);
  deliver(&links[kState], request.state, sizeof request.state);
}

static void spend(int64_t ns) {
  while (now_ns + ns >= end_ns) {
    ns -= end_ns - now_ns;
    now_ns = end_ns;
    exchange();
  }
  now_ns += ns;
}

int clock_gettime(clockid_t id, struct timespec* time) {
  if (simulator < 0 || id != CLOCK_MONOTONIC) return (int)syscall(SYS_clock_gettime, id, time);
  if (running == NULL) spend(kReadingNs);
  time->tv_sec = now_ns / 1000000000;
  time->tv_nsec = now_ns % 1000000000;
  return 0;
}

int nanosleep(const struct timespec* time, struct timespec* left) {
  if (simulator < 0) return (int)syscall(SYS_nanosleep, time, left);
  spend(time->tv_sec * 1000000000 + time->tv_nsec);
  return 0;
}

static void run_worker(void) { running->run(NULL); }

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*), void* argument) {
  static int (*real)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
  if (simulator < 0) {
    if (real == NULL) real = (int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*))dlsym(RTLD_NEXT, "pthread_create");
    return real(thread, attributes, run, argument);
  }
  // The order of sitl.c: TCP, state, sticks.
  static const int kLinkOf[] = {-1, kState, kSticks};
  const int which = workers < 3 ? kLinkOf[workers] : -1;
  ++workers;
  if (which < 0) return 0;
  Link* link = &links[which];
  link->run = run;
  getcontext(&link->context);
  link->context.uc_stack.ss_sp = link->stack;
  link->context.uc_stack.ss_size = sizeof link->stack;
  makecontext(&link->context, run_worker, 0);
  return 0;
}

int select(int count, fd_set* readable, fd_set* writable, fd_set* failed, struct timeval* timeout) {
  static int (*real)(int, fd_set*, fd_set*, fd_set*, struct timeval*);
  if (running == NULL) {
    if (real == NULL) real = (int (*)(int, fd_set*, fd_set*, fd_set*, struct timeval*))dlsym(RTLD_NEXT, "select");
    return real(count, readable, writable, failed, timeout);
  }
  Link* self = running;
  while (self->packet == NULL) swapcontext(&self->context, &main_context);
  return 1;
}

ssize_t recvfrom(int file, void* to, size_t size, int flags, struct sockaddr* from, socklen_t* length) {
  if (running == NULL) return syscall(SYS_recvfrom, file, to, size, flags, from, length);
  if (size > running->size) size = running->size;
  memcpy(to, running->packet, size);
  running->packet = NULL;
  return (ssize_t)size;
}

ssize_t sendto(int file, const void* from, size_t size, int flags, const struct sockaddr* to, socklen_t length) {
  if (simulator < 0) return syscall(SYS_sendto, file, from, size, flags, to, length);
  const struct sockaddr_in* address = (const struct sockaddr_in*)to;
  if (size == sizeof motors && ntohs(address->sin_port) == kPortOfMotors) memcpy(motors, from, size);
  return (ssize_t)size;
}

int bind(int file, const struct sockaddr* address, socklen_t length) {
  if (simulator >= 0) return 0;
  struct sockaddr_in6 mine = {0};  // large enough for both families, which have the port at the same place
  if (length > sizeof mine) return -1;
  memcpy(&mine, address, length);
  asked_port = ntohs(mine.sin6_port);
  mine.sin6_port = 0;
  if (address->sa_family == AF_INET6) {
    mine.sin6_addr = in6addr_loopback;
  } else {
    ((struct sockaddr_in*)&mine)->sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  return (int)syscall(SYS_bind, file, &mine, length);
}

int listen(int file, int backlog) {
  if (simulator >= 0) return 0;
  const int result = (int)syscall(SYS_listen, file, backlog);
  struct sockaddr_in6 mine;
  socklen_t size = sizeof mine;
  if (result == 0 && getsockname(file, (struct sockaddr*)&mine, &size) == 0) {
    dprintf(STDERR_FILENO, "port %d is %d\n", asked_port, ntohs(mine.sin6_port));
  }
  return result;
}
