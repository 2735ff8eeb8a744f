# The libraries of the engine, gathered in `flockstep_dependencies`; the engine's own headers show none but Eigen.
add_library(flockstep_dependencies INTERFACE)

# need(FOUND WHAT DEBIAN CONDA): notes what is missing, and the packages that bring it; all is told at once, at the end.
macro(need found what debian conda)
  if(NOT ${found})
    string(APPEND missing "\n  ${what}: ${debian} on Debian and Ubuntu, ${conda} from conda-forge")
  endif()
endmacro()
set(missing "")

find_package(PkgConfig QUIET)
need(PkgConfig_FOUND "pkg-config" pkg-config pkg-config)
find_package(Eigen3 QUIET NO_MODULE)
need(Eigen3_FOUND "Eigen (small vectors, poses)" libeigen3-dev eigen)
find_package(TBB QUIET)
need(TBB_FOUND "oneTBB (threads)" libtbb-dev tbb-devel)
find_package(nlohmann_json QUIET)
need(nlohmann_json_FOUND "nlohmann_json (scene files)" nlohmann-json3-dev nlohmann_json)
target_link_libraries(flockstep_dependencies INTERFACE TBB::tbb nlohmann_json::nlohmann_json)

# Rays. Embree 4 where there is one, else 3.13; engine/src/trace/embree.hpp is the one place that knows the difference.
find_package(embree 4 QUIET)
if(NOT embree_FOUND)
  find_package(embree 3.13 QUIET)
endif()
need(embree_FOUND "Embree of at least 3.13 (rays)" libembree-dev embree)
string(REGEX MATCH "^[0-9]+" embree_major "${embree_VERSION}")
target_compile_definitions(flockstep_dependencies INTERFACE FLOCKSTEP_EMBREE_MAJOR=${embree_major})
target_link_libraries(flockstep_dependencies INTERFACE embree)

# find_either(NAME PKG_CONFIG PACKAGE TARGET): NAME_FOUND by a pkg-config file, which is what distributions ship, else by
# upstream's CMake package.
macro(find_either name pkg_config package target)
  if(PkgConfig_FOUND)
    pkg_check_modules(${name} QUIET IMPORTED_TARGET ${pkg_config})
  endif()
  if(${name}_FOUND)
    target_link_libraries(flockstep_dependencies INTERFACE PkgConfig::${name})
  else()
    find_package(${package} QUIET)
    set(${name}_FOUND ${${package}_FOUND})
    set(${name}_VERSION ${${package}_VERSION})
    target_link_libraries(flockstep_dependencies INTERFACE ${target})
  endif()
endmacro()

find_either(HWY libhwy hwy hwy::hwy)
need(HWY_FOUND "Highway (SIMD with run-time dispatch)" libhwy-dev libhwy)
# Arm's scalable vectors cannot be members of structs, as the kernels have them; such processors run the NEON kernels. What later
# processors have beside AVX-512 is of no use to floats: each target is compiled anew.
set(disabled_targets HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128|HWY_SSSE3|HWY_AVX3_DL)
if(HWY_VERSION VERSION_GREATER_EQUAL 1.1) # which has these
  string(APPEND disabled_targets |HWY_AVX3_ZEN4|HWY_AVX3_SPR)
endif()
if(FLOCKSTEP_SANITIZE) # a minute and a half a target: the sanitizers see two
  string(APPEND disabled_targets |HWY_AVX3)
endif()
# Kernels use no instructions for AES, without which Highway would not take SSE4 for what all processors have.
target_compile_definitions(flockstep_dependencies INTERFACE HWY_DISABLE_PCLMUL_AES)
target_compile_definitions(flockstep_dependencies INTERFACE HWY_DISABLED_TARGETS=${disabled_targets})

find_either(TURBOJPEG libturbojpeg libjpeg-turbo libjpeg-turbo::turbojpeg)
need(TURBOJPEG_FOUND "libjpeg-turbo (JPEG files of camera frames and textures)" libturbojpeg0-dev libjpeg-turbo)
find_package(PNG QUIET)
need(PNG_FOUND "libpng (textures)" libpng-dev libpng)
target_link_libraries(flockstep_dependencies INTERFACE PNG::PNG)

# OpenCV, core and imgproc alone. Debian's shared libraries depend on BLAS, LAPACK, libgfortran and libGLX, which nothing here uses:
# its static libraries are linked instead, and the linker leaves out every section that is not reached, those that would need these
# included. What would need them after all does not link. Elsewhere shared libraries will do. Symbols stay hidden, so another
# OpenCV in the process is of no concern.
find_path(OPENCV_INCLUDE_DIR opencv2/imgproc.hpp PATH_SUFFIXES opencv4)
find_library(OPENCV_CORE NAMES libopencv_core.a opencv_core)
find_library(OPENCV_IMGPROC NAMES libopencv_imgproc.a opencv_imgproc)
if(OPENCV_INCLUDE_DIR AND OPENCV_CORE AND OPENCV_IMGPROC)
  set(OPENCV_FOUND TRUE)
endif()
need(OPENCV_FOUND "OpenCV, core and imgproc (images)" "libopencv-core-dev libopencv-imgproc-dev" libopencv)
target_include_directories(flockstep_dependencies SYSTEM INTERFACE ${OPENCV_INCLUDE_DIR})
target_link_libraries(flockstep_dependencies INTERFACE ${OPENCV_IMGPROC} ${OPENCV_CORE} PNG::PNG TBB::tbb ${CMAKE_DL_LIBS})
if(OPENCV_CORE MATCHES "\\.a$")
  target_link_options(flockstep_dependencies INTERFACE LINKER:--gc-sections
                      LINKER:--exclude-libs,libopencv_core.a:libopencv_imgproc.a)
endif()

# OpenGL and EGL, whose functions it finds at run time: neither is linked, and a machine without them has one camera backend less.
if(FLOCKSTEP_GL)
  if(PkgConfig_FOUND)
    pkg_check_modules(EPOXY QUIET IMPORTED_TARGET epoxy)
  endif()
  need(EPOXY_FOUND "libepoxy (OpenGL)" libepoxy-dev libepoxy)
  target_link_libraries(flockstep_dependencies INTERFACE PkgConfig::EPOXY)
endif()

# Convex distance: Bullet's GJK and EPA, which are templates in headers; nothing of Bullet is linked.
find_path(BULLET_INCLUDE_DIR BulletCollision/NarrowPhaseCollision/btGjkEpa3.h PATH_SUFFIXES bullet)
need(BULLET_INCLUDE_DIR "Bullet (convex distance)" libbullet-dev bullet)
target_include_directories(flockstep_dependencies SYSTEM INTERFACE ${BULLET_INCLUDE_DIR})

# The server: WebSockets by Boost.Beast, messages by protozero (headers only), TLS by OpenSSL.
add_library(flockstep_network INTERFACE)
find_package(Boost 1.74 QUIET)
need(Boost_FOUND "Boost of at least 1.74 (headers of Beast and Asio: WebSockets)" libboost-dev libboost-headers)
find_path(PROTOZERO_INCLUDE_DIR protozero/pbf_reader.hpp)
need(PROTOZERO_INCLUDE_DIR "protozero (messages)" libprotozero-dev protozero)
find_package(OpenSSL QUIET)
need(OpenSSL_FOUND "OpenSSL (TLS)" libssl-dev openssl)
find_package(Threads REQUIRED)
target_include_directories(flockstep_network SYSTEM INTERFACE ${Boost_INCLUDE_DIRS} ${PROTOZERO_INCLUDE_DIR})
target_link_libraries(flockstep_network INTERFACE OpenSSL::SSL OpenSSL::Crypto Threads::Threads)
# Errors by exceptions of <system_error>; nothing of Boost is linked.
target_compile_definitions(flockstep_network INTERFACE BOOST_ERROR_CODE_HEADER_ONLY BOOST_ASIO_NO_DEPRECATED)

if(missing)
  message(FATAL_ERROR "flockstep needs these, which are not there:${missing}\n")
endif()
