{{ comment }}
#include "{{ header }}"

#include <math.h>

{% for name, values in limits %}
const ssm_real {{ name }}[4] = { {{- values | join(", ") -}} };
{% endfor %}

{{ sign }}
{{ bodies }}
