# The server and the protocol, which the C++ client shares; cmake/Library.cmake makes a library of the client.
find_package(Python3 REQUIRED COMPONENTS Interpreter) # writes the messages from the list of operations
set(generated ${CMAKE_CURRENT_BINARY_DIR}/server)
set(messages ${generated}/protocol/messages.cpp ${generated}/protocol/messages.hpp ${generated}/service/operations.inc
             ${generated}/client/operations.cpp ${generated}/flockstep/client_operations.hpp
             ${generated}/flockstep/client_results.hpp)
set(schema envs/flockstep/client/flockstep.proto envs/flockstep/client/schema.py)
add_custom_command(OUTPUT ${generated}/written BYPRODUCTS ${messages} DEPENDS server/generate.py server/client_operations.py ${schema}
                   COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/server/generate.py ${generated}
                   COMMAND ${CMAKE_COMMAND} -E touch ${generated}/written)
add_custom_target(flockstep_messages DEPENDS ${generated}/written)
file(GLOB protocol_sources CONFIGURE_DEPENDS server/src/protocol/*.cpp)
list(APPEND protocol_sources ${generated}/protocol/messages.cpp)
set_source_files_properties(${messages} PROPERTIES GENERATED ON)
file(GLOB service_sources CONFIGURE_DEPENDS server/src/service/*.cpp)

add_library(flockstep_protocol OBJECT ${protocol_sources})
add_library(flockstep_server OBJECT ${service_sources})
foreach(target flockstep_protocol flockstep_server)
  add_dependencies(${target} flockstep_messages)
  target_include_directories(${target} PUBLIC server/include ${generated} PRIVATE server/src engine/include engine/src)
  target_link_libraries(${target} PUBLIC Eigen3::Eigen PRIVATE flockstep_options flockstep_dependencies flockstep_network)
endforeach()
target_compile_options(flockstep_server PRIVATE "${options_of_calls}") # what handles values is in the protocol
compile_folders_as_one(flockstep_server "" ${service_sources})
set_target_properties(flockstep_protocol PROPERTIES UNITY_BUILD ${FLOCKSTEP_UNITY})
