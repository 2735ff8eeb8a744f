# The server and the protocol, which the C++ client shares; cmake/Library.cmake makes a library of the client.
file(GLOB protocol_sources CONFIGURE_DEPENDS server/src/protocol/*.cpp)
file(GLOB service_sources CONFIGURE_DEPENDS server/src/service/*.cpp)

add_library(flockstep_protocol OBJECT ${protocol_sources})
add_library(flockstep_server OBJECT ${service_sources})
foreach(target flockstep_protocol flockstep_server)
  target_include_directories(${target} PUBLIC server/include PRIVATE server/src engine/include engine/src)
  target_link_libraries(${target} PUBLIC Eigen3::Eigen PRIVATE flockstep_options flockstep_dependencies flockstep_network)
endforeach()
compile_folders_as_one(flockstep_server "" ${service_sources})
