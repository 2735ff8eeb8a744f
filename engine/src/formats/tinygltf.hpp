// tinygltf as it is compiled here: it decodes no images and opens no files.
#pragma once

#include <fstream>            // which it forgets without files
#include <nlohmann/json.hpp>  // which it would hide the symbols of

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_FS
#include <tiny_gltf.h>
