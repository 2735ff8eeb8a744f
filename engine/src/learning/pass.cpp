#include "learning/pass.hpp"

#include <utility>

namespace flockstep::learning {

Pass::Pass(const Network& network) : network_(network), inputs_(kRows * padded(network.actor.front().in)) {
  for (const auto& [layers, values] : {std::pair{&network.actor, &actor_}, std::pair{&network.critic, &critic_}}) {
    for (const Layer& layer : *layers) {
      const std::size_t count = kRows * padded(layer.out);
      values->push_back({AlignedVector<float>(count), AlignedVector<float>(count)});
    }
  }
}

const float* Pass::forward(const std::vector<Layer>& layers, std::vector<Values>& values, const float* parameters,
                           const float* transposed, std::size_t rows) {
  const float* from = inputs_.data();
  for (std::size_t i = 0; i < layers.size(); ++i) {
    learning::forward(layers[i], parameters, transposed, from, rows, values[i].outputs.data());
    from = values[i].outputs.data();
  }
  return from;
}

void Pass::backward(const std::vector<Layer>& layers, std::vector<Values>& values, const float* parameters, std::size_t rows,
                    float* gradient) {
  for (std::size_t i = layers.size(); i-- > 0;) {
    const float* const from = i == 0 ? inputs_.data() : values[i - 1].outputs.data();
    add_gradient(layers[i], from, values[i].gradients.data(), rows, gradient);
    if (i > 0) {
      learning::backward(layers[i], parameters, values[i].gradients.data(), layers[i - 1].after, from, rows,
                         values[i - 1].gradients.data());
    }
  }
}

}  // namespace flockstep::learning
