// Runs Betaflight's simulator target in lockstep without changing it: LD_PRELOAD puts these functions before the C library's.
//
// The firmware is one thread and three workers [src/platform/SIMULATOR/sitl.c: systemInit]. Here the two that receive UDP packets
// are coroutines of the main thread, and the third, which serves TCP, does not run. So nothing depends on the scheduling of
// threads, no port is open, and a fork copies a running firmware.
//
// Time is simulated. Each reading of the clock takes kReadingNs, and a sleep takes its duration. Where a tick ends, the motors
// are sent to the simulator, and the next state and sticks are received.
//
// If FLOCKSTEP_LOCKSTEP is not set, time is real and only ports change: the system chooses them, and they are open on this
// machine only. Then the TCP worker waits until its port listens: otherwise it may destroy it [../lib/main/dyad/dyad.c:
// dyad_update].
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dlfcn.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <time.h>
#include <ucontext.h>
#include <unistd.h>

#define C_LIBRARY(function) ((__typeof__(&function))dlsym(RTLD_NEXT, #function))

enum { kState, kSticks, kLinks, kReadingNs = 1000, kStartNs = 1000000000, kMotorsPort = 9002 };

typedef struct {
  int64_t tick_ns;      // 0: copy this process; the socket of the copy comes with the request
  int64_t has_packets;  // 0 while the firmware starts: if it receives sticks before it initialises the receiver, it forgets them
  uint8_t state[144];   // fdm_packet
  uint8_t sticks[40];   // rc_packet
} Request;

// A worker that receives packets.
typedef struct {
  void* (*run)(void*);
  const void* packet;  // to be received; NULL: none
  ucontext_t context;
  char stack[1 << 18];
} Link;

static int simulator = -1;  // socket to the simulator; -1: no lockstep
static int64_t now_ns = kStartNs, end_ns = kStartNs;
static Request request;
static float motors[4];
static Link links[kLinks];
static Link* running;  // NULL: the main thread
static ucontext_t main_thread;
static int asked_port;   // of the last bind()
static int tcp_listens;  // without lockstep
static pthread_t* tcp_thread;
static void* (*tcp_worker)(void*);  // NULL: has begun

__attribute__((constructor)) static void begin(void) {
  const char* file = getenv("FLOCKSTEP_LOCKSTEP");
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // ends with the program that started it; copies end with their sockets
  if (file == NULL) return;
  simulator = atoi(file);
  signal(SIGCHLD, SIG_IGN);  // nobody waits for the copies
}

static void receive(void) {
  for (;;) {
    char control[CMSG_SPACE(sizeof(int))];
    struct iovec data = {&request, sizeof request};
    struct msghdr message = {.msg_iov = &data, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
    if (recvmsg(simulator, &message, 0) != (ssize_t)sizeof request) _exit(0);  // the simulator has ended
    if (request.tick_ns > 0) return;
    const struct cmsghdr* header = CMSG_FIRSTHDR(&message);
    if (header == NULL) _exit(1);
    int file;
    memcpy(&file, CMSG_DATA(header), sizeof file);
    if (fork() == 0) {
      close(simulator);
      simulator = file;
    } else {
      close(file);
    }
  }
}

static void deliver(Link* link, const void* packet) {
  link->packet = packet;
  running = link;
  swapcontext(&main_thread, &link->context);
  running = NULL;
}

static void end_tick(void) {
  const int is_first = end_ns == kStartNs;  // nothing has been asked for yet
  if (!is_first && send(simulator, motors, sizeof motors, MSG_NOSIGNAL) != (ssize_t)sizeof motors) _exit(0);
  receive();
  end_ns += request.tick_ns;
  if (!request.has_packets) return;
  deliver(&links[kSticks], request.sticks);
  deliver(&links[kState], request.state);
}

static void spend(int64_t ns) {
  if (running != NULL) return;  // workers take no time
  for (; now_ns + ns >= end_ns; end_tick()) {
    ns -= end_ns - now_ns;
    now_ns = end_ns;
  }
  now_ns += ns;
}

int clock_gettime(clockid_t id, struct timespec* time) {
  if (simulator < 0 || id != CLOCK_MONOTONIC) return C_LIBRARY(clock_gettime)(id, time);
  spend(kReadingNs);
  time->tv_sec = now_ns / 1000000000;
  time->tv_nsec = now_ns % 1000000000;
  return 0;
}

int nanosleep(const struct timespec* time, struct timespec* left) {
  if (simulator < 0) {
    if (tcp_listens && tcp_worker != NULL && C_LIBRARY(pthread_create)(tcp_thread, NULL, tcp_worker, NULL) == 0)
      tcp_worker = NULL;
    return C_LIBRARY(nanosleep)(time, left);
  }
  spend(time->tv_sec * 1000000000 + time->tv_nsec);
  return 0;
}

static void work(void) { running->run(NULL); }

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*), void* argument) {
  static int created;  // TCP, state, sticks
  const int index = created++ - 1;
  if (index < 0) {
    tcp_thread = thread;
    tcp_worker = run;
    return 0;
  }
  if (simulator < 0) return C_LIBRARY(pthread_create)(thread, attributes, run, argument);
  if (index >= kLinks) return -1;
  Link* link = &links[index];
  link->run = run;
  getcontext(&link->context);
  link->context.uc_stack.ss_sp = link->stack;
  link->context.uc_stack.ss_size = sizeof link->stack;
  makecontext(&link->context, work, 0);
  return 0;
}

int select(int count, fd_set* readable, fd_set* writable, fd_set* failed, struct timeval* timeout) {
  if (running == NULL) return C_LIBRARY(select)(count, readable, writable, failed, timeout);
  Link* self = running;
  while (self->packet == NULL) swapcontext(&self->context, &main_thread);
  return 1;
}

ssize_t recvfrom(int file, void* to, size_t size, int flags, struct sockaddr* from, socklen_t* length) {
  if (running == NULL) return C_LIBRARY(recvfrom)(file, to, size, flags, from, length);
  memcpy(to, running->packet, size);  // the firmware asks for exactly one packet
  running->packet = NULL;
  return (ssize_t)size;
}

ssize_t sendto(int file, const void* from, size_t size, int flags, const struct sockaddr* to, socklen_t length) {
  if (simulator < 0) return C_LIBRARY(sendto)(file, from, size, flags, to, length);
  const struct sockaddr_in* address = (const struct sockaddr_in*)to;
  if (size == sizeof motors && ntohs(address->sin_port) == kMotorsPort) memcpy(motors, from, size);
  return (ssize_t)size;
}

int bind(int file, const struct sockaddr* address, socklen_t length) {
  struct sockaddr_in6 here = {0};  // has room for both families, whose ports are at the same place
  if (simulator >= 0) return 0;
  if (length > sizeof here) return -1;
  memcpy(&here, address, length);
  asked_port = ntohs(here.sin6_port);
  here.sin6_port = 0;
  if (address->sa_family == AF_INET6) {
    here.sin6_addr = in6addr_loopback;
  } else {
    ((struct sockaddr_in*)&here)->sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  return C_LIBRARY(bind)(file, (const struct sockaddr*)&here, length);
}

int listen(int file, int backlog) {
  struct sockaddr_in6 here;
  socklen_t size = sizeof here;
  if (simulator >= 0) return 0;
  const int result = C_LIBRARY(listen)(file, backlog);
  if (result == 0 && getsockname(file, (struct sockaddr*)&here, &size) == 0) {
    dprintf(STDERR_FILENO, "port %d is %d\n", asked_port, ntohs(here.sin6_port));
    tcp_listens = 1;
  }
  return result;
}
